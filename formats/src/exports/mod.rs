//! Scenes in the layouts of other programs: one file per moment, Spacetime Gaussians, SPZ; and as moving pictures.

mod animation;
mod sequence;
mod spz;
mod stg;

pub use animation::{Film, write_animation};
pub use sequence::{num_files, write_sequence};
pub use spz::{Written as WrittenSpz, write_spz};
pub use stg::write_stg;
