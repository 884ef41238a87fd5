//! The engine: from a clip to a dynamic Gaussian scene, its views and their figures.
//!
//! Modules stand in the order in which data run through them; a module uses those above it only.

pub mod allocator;
mod cholesky;
pub mod error;
mod parallel;
pub mod words;

pub mod ops;

pub mod views;

pub mod points;

pub mod calibration;

pub mod gaussians;

pub mod photometry;

pub mod network;

pub mod predict;

pub mod densify;

pub mod render;

pub mod loss;

pub mod objective;

pub mod evidence;

pub mod refine;

pub mod evaluate;

pub mod export;

pub mod recipe;

pub mod pipeline;

pub mod plan;

pub mod report;
