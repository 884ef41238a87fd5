//! How cost grows with the number of points and of pixels: procedural clips from small to large, each stage's time and memory against its
//! own work, and the exponent that fits.
//!
//! Modules stand in the order in which data run through them; a module uses those above it only.

pub mod plan;

pub mod street;

pub mod fit;

pub mod part;

pub mod work;

pub mod profiler;

pub mod measure;

pub mod record;

pub mod table;

mod csv;

mod plot;

mod page;

pub mod job;
