//! The network: passes of both branches, query, and where their weights come from.

pub mod branch;
pub mod config;
mod conv;
pub mod describe;
pub mod guide;
pub mod heads;
pub mod levels;
pub mod linear;
pub mod model;
mod norm;
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
