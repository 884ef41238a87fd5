//! Training: scenes that we can make and measure.

pub mod error;
pub mod scenes;
