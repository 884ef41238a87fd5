//! The network: passes of both branches, query, and where their weights come from.

pub mod buffers;
pub mod config;
pub mod describe;
pub mod guide;
pub mod heads;
pub mod layers;
pub mod levels;
pub mod linear;
pub mod model;
pub mod normalise;
pub mod pass;
pub mod policy;
pub mod query;
#[cfg(test)]
mod samples;
pub mod shipped;
pub mod source;
pub mod unet;
pub mod weights;
