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

pub(crate) mod lanes;
pub(crate) mod tensors;
#[cfg(test)]
mod test_support;
