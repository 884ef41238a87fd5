//! Splat clouds as PLY files that the common viewers read.
//!
//! # Layout
//! A text header of lines that end in `\n`, then N packed records of little-endian f32, nothing else:
//! ```text
//! ply
//! format binary_little_endian 1.0
//! element vertex N
//! property float x          property float y .. z       position at the splat's own time, metres
//! property float nx         .. ny nz                    0; there because the 3DGS layout has them
//! property float f_dc_0     .. f_dc_2                   colour: 0.5 + 0.28209479 f_dc
//! property float opacity                                logit
//! property float scale_0    .. scale_2                  natural logarithm of metres
//! property float rot_0      .. rot_3                    quaternion w, x, y, z
//! property float vx         .. vy vz                    velocity, metres per second
//! property float t                                      time at which the splat stands at (x, y, z), seconds
//! property float frame                                  index of the clip's frame that the splat comes from, where it is known
//! property float <name>                                 further columns, any number
//! end_header
//! ```
//! The reader takes properties in any order and of any scalar type (converted to f32), `nx ny nz` and `f_rest_*` are
//! skipped, `vx vy vz t` are 0 where they are missing, `frame` may be missing, `comment` and `obj_info` lines and elements of no entries
//! are skipped. Every value must be finite, a frame whole
//! and at most 2^24, up to which f32 counts. What the writer writes is read back to the same bits.

mod header;
mod read;
#[cfg(test)]
mod tests;
mod write;

pub use read::read_ply;
pub use write::{Higher, to_bytes, write_plain_ply, write_ply};
pub(crate) use write::{check_lengths, encode};

const POSITION: [&str; 3] = ["x", "y", "z"];
const NORMAL: [&str; 3] = ["nx", "ny", "nz"];
const COLOUR: [&str; 3] = ["f_dc_0", "f_dc_1", "f_dc_2"];
const OPACITY: &str = "opacity";
const SCALE: [&str; 3] = ["scale_0", "scale_1", "scale_2"];
const ROTATION: [&str; 4] = ["rot_0", "rot_1", "rot_2", "rot_3"];
const VELOCITY: [&str; 3] = ["vx", "vy", "vz"];
const TIME: &str = "t";
const FRAME: &str = "frame";
/// Largest index of a frame: f32 counts no further.
const MAX_FRAME: u32 = 1 << 24;
/// Higher spherical harmonics of other programs' files.
const HIGHER_COLOUR_PREFIX: &str = "f_rest_";
/// How many of them spherical harmonics of degree 3 have.
const NUM_HIGHER: usize = 45;

/// The named properties in the order in which they are written.
fn fixed_names() -> impl Iterator<Item = &'static str> {
    let before = POSITION.into_iter().chain(NORMAL).chain(COLOUR).chain([OPACITY]);
    before.chain(SCALE).chain(ROTATION).chain(VELOCITY).chain([TIME])
}

/// Whether a property is a further column: one that the layout neither names nor skips.
fn is_extra(name: &str) -> bool {
    !name.starts_with(HIGHER_COLOUR_PREFIX) && name != FRAME && fixed_names().all(|fixed| fixed != name)
}
