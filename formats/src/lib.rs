//! Bytes to validated host structs and back: clips, sweeps, images, splat clouds. No tensors, no threads.

pub mod camera;
pub mod clip;
pub mod image;
pub mod pose;
