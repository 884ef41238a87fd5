//! Operations that candle lacks or does slowly, each with its gradient and a slow twin.

pub mod activation;
pub mod attention;
pub mod dense;
pub mod knn;
pub mod neighbour_mean;
pub mod norm;
pub mod segment;
pub mod serialization;
pub mod sparse_conv;

use candle_core::Device;

/// Where tensors live and operations run: the one place that says so.
pub const DEVICE: Device = Device::Cpu;

pub(crate) mod lanes;
pub mod tensors;
#[cfg(test)]
mod test_support;
