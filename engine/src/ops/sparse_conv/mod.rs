//! Sparse convolution over occupied voxels: submanifold, strided, transposed.
//!
//! # Formula
//! `out[q] = sum_o W[o] in[s q + o]` over the offsets `o` that hit an occupied voxel (cross-correlation).
//!
//! # Source
//! Graham et al., 3D semantic segmentation with submanifold sparse convolutional networks, 2018; Choy et al., Minkowski, 2019.

mod kernel;
mod map;
mod op;
mod pack;
pub mod reference;
mod sites;
mod weight_gradient;

pub use kernel::{Epilogue, convolve_into};
pub use map::{Halving, KernelMap};
pub use op::{by_features, convolve};
pub use pack::{ConvWeights, PackedWeights, WeightShape};
pub use sites::Sites;
pub use weight_gradient::by_weights;
