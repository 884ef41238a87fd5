//! Weights: which tensors a model has, where their values come from, what is wrong with a file.

mod random;
mod recorder;
mod store;

pub use random::RandomWeights;
pub use recorder::{Recorder, TensorSpec};
pub use store::WeightFile;
