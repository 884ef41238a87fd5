//! Operations that candle lacks or does slowly, each with its gradient and a slow twin.

pub mod knn;
pub mod serialization;
