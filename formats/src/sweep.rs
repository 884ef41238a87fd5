//! `LiDAR` sweeps.
