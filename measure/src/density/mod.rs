//! Which Gaussians a scene needs: held-out PSNR against their number, by what decides which of them stay.

mod entropy;

pub mod signal;

pub mod record;

pub mod measure;

pub mod compare;
pub mod markdown;
pub mod picture;

pub mod job;
