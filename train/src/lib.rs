//! Training: scenes that we can make and measure, and the stages that train the network on them.

pub mod error;
pub mod scenes;
pub mod velocity;

pub mod stages;

pub mod ship;
