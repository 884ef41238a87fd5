//! The stages of training: which clips are read, what a step is computed from, the optimiser, what is kept and recorded.

pub mod clips;

pub mod augment;
pub mod sample;

pub mod settings;
pub mod variables;
pub mod weights;

pub mod adamw;
pub mod schedule;

pub mod backbone;
pub mod frozen;
mod passes;

pub mod checkpoint;
pub mod plot;
pub mod record;
pub mod validate;

pub mod task;

pub mod policy;
pub mod rendering;

pub mod train;
