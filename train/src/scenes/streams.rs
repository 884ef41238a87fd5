//! Independent streams of draws of one seed.

pub(crate) const CONFIG: u64 = 0;
pub(crate) const HOUSES: u64 = 1;
pub(crate) const TREES: u64 = 2;
pub(crate) const FURNITURE: u64 = 3;
pub(crate) const PARKED: u64 = 4;
pub(crate) const TRAFFIC: u64 = 5;
pub(crate) const GROUND: u64 = 6;
pub(crate) const BACKDROP: u64 = 7;
pub(crate) const LIGHT: u64 = 8;
pub(crate) const BUSY: u64 = 9;
pub(crate) const BUSY_CONFIG: u64 = 10;
/// Plus frame * 2^16 + beam.
pub(crate) const LIDAR: u64 = 1 << 40;
