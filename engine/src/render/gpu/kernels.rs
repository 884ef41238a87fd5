//! The kernels' sources, and what stands before each: constants and layouts that Rust and WGSL share.

use super::super::constants::{
    ALPHA_MAX, ALPHA_MIN, EXPECTED_DEPTH_EPS, LOG2_ALPHA_MIN, NEAR_PLANE, TILE_HEIGHT, TILE_WIDTH,
};
use crate::views::shutter::FASTEST;

/// Sums of an intersection: ten moments and two maps.
pub(crate) const SUMS: usize = 12;
/// Numbers of a Gaussian's row of gradients: 17 by physical values, two sums of maps, whether it is seen.
pub(crate) const ROW: usize = 20;
/// First of the two sums of maps in a row.
pub(crate) const MAPPED: usize = 17;
/// What in a row says whether the Gaussian is seen.
pub(crate) const SEEN: usize = 19;

/// A kernel: its entry point and the sources that it needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kernel {
    /// Its name, which no other has.
    pub(crate) name: &'static str,
    /// Entry point.
    pub(crate) entry: &'static str,
    /// WGSL, beside what every kernel has.
    pub(crate) sources: &'static [&'static str],
    /// Constants of its own, as WGSL.
    pub(crate) constants: fn() -> String,
}

impl Kernel {
    /// A kernel without constants of its own.
    pub(crate) const fn new(name: &'static str, sources: &'static [&'static str]) -> Self {
        Self::with(name, sources, String::new)
    }

    /// A kernel with constants of its own.
    pub(crate) const fn with(name: &'static str, sources: &'static [&'static str], constants: fn() -> String) -> Self {
        Self { name, entry: name, sources, constants }
    }

    /// Its whole WGSL.
    pub(super) fn text(&self) -> String {
        let mut text = constants() + &(self.constants)();
        self.sources.iter().for_each(|source| text += source);
        text
    }
}

/// A constant of f32.
pub(crate) fn single(name: &str, value: f32) -> String {
    format!("const {name}: f32 = {value:?}f;\n")
}

/// A constant of u32.
pub(crate) fn count(name: &str, value: usize) -> String {
    format!("const {name}: u32 = {value}u;\n")
}

#[expect(clippy::cast_possible_truncation, reason = "f64 to f32 is the purpose")]
fn constants() -> String {
    let singles = [
        ("ALPHA_MAX", ALPHA_MAX),
        ("ALPHA_MIN", ALPHA_MIN),
        ("LOG2_ALPHA_MIN", LOG2_ALPHA_MIN),
        ("NEAR_PLANE", NEAR_PLANE as f32),
        ("EXPECTED_DEPTH_EPS", EXPECTED_DEPTH_EPS),
        ("SHUTTER_FASTEST", FASTEST as f32),
        ("HALF_LOG2_E", 0.5 * std::f32::consts::LOG2_E),
        // A list position that no list reaches.
        ("NEVER", f32::MAX),
    ];
    let counts = [
        ("TILE_WIDTH", TILE_WIDTH),
        ("TILE_HEIGHT", TILE_HEIGHT),
        ("SUMS", SUMS),
        ("ROW", ROW),
        ("MAPPED", MAPPED),
        ("SEEN", SEEN),
    ];
    let mut text: String = singles.map(|(name, value)| single(name, value)).concat();
    text += &counts.map(|(name, value)| count(name, value)).concat();
    // Groups stand in two dimensions where one has not room for them.
    text + "fn linear(group: vec3<u32>, groups: vec3<u32>) -> u32 { return group.y * groups.x + group.x; }\n"
}
