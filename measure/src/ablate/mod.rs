//! What each part of the system is worth on views that it did not see: learned refinement against per-scene optimisation, query, policy,
//! velocities. Everything runs through the engine's own pipeline.

pub mod settings;
pub mod subject;

pub mod rates;

pub mod record;

pub mod ways;

pub mod scene;

pub mod compare;
pub mod csv;
pub mod markdown;
pub mod picture;

pub mod job;
