//! Operations that candle lacks or does slowly, each with its gradient and a slow twin.

pub mod knn;
pub mod neighbour_mean;
pub mod serialization;
pub mod sparse_conv;
