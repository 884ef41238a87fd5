//! What measures: the trade of time against accuracy, how cost grows, and what each part of the system is worth.
//!
//! Modules stand in the order in which data run through them; a module uses those above it only.

pub mod error;

pub mod statistics;

pub mod records;

pub mod means;

pub mod clips;

pub mod machine;

pub mod sweep;

pub mod scaling;

pub mod ablate;

pub mod density;

pub mod evaluate;
