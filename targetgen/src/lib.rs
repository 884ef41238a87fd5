//! Training targets of the densify policy: what pruning or copying a primitive does to its surroundings.
//!
//! Modules stand in the order in which data run through them; a module uses those above it only.

pub mod error;

pub mod sample;

pub mod response;

pub mod branches;

pub mod footprint;

pub mod delta;

pub mod exact;

pub mod target;

pub mod reference;

pub mod scene;

pub mod generate;

pub mod job;

pub mod report;

pub mod fidelity;
