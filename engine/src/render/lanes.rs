//! Vector arithmetic that the compositing passes share.

use pulp::Simd;

use super::constants::{ALPHA_MAX, ALPHA_MIN, TILE_WIDTH};
use super::project::Footprint;
use crate::ops::lanes::exp2;

/// Centres of the pixels of a row of a tile, relative to the tile's left edge.
const PIXEL_CENTRES: [f32; TILE_WIDTH] = {
    let mut centres = [0.0; TILE_WIDTH];
    let mut i = 0;
    while i < TILE_WIDTH {
        centres[i] = i as f32 + 0.5;
        i += 1;
    }
    centres
};

/// One row of a Gaussian inside a tile.
#[derive(Clone, Copy, Debug)]
pub(super) struct RowSpan {
    /// x at which the row's alpha is largest, relative to the tile's left edge, pixels.
    pub(super) peak_x: f32,
    /// Exponent at the peak, base 2.
    pub(super) peak_log2: f32,
    /// Height above the mean, pixels.
    pub(super) dy: f32,
    /// First and last pixel of the row in the tile.
    pub(super) first: usize,
    pub(super) last: usize,
}

impl RowSpan {
    /// The part of image row `y` inside the tile at `left` in which the Gaussian can reach the minimum alpha.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the tile before the cast")]
    pub(super) fn of(f: &Footprint, left: f32, y: f32) -> Option<Self> {
        let dy = y - f.mean_y;
        let peak_x = (f.mean_x - left) + f.shear * dy;
        let half = f.half_width(dy) + 1e-3;
        let first = (peak_x - half - 0.5).max(0.0);
        let last = (peak_x + half - 0.5).min(TILE_WIDTH as f32 - 1.0);
        // The cast of a non-negative float rounds down: at most one pixel too many at the left.
        if first <= last {
            let peak_log2 = f.log2_opacity + f.curve_y * dy * dy;
            Some(Self { peak_x, peak_log2, dy, first: first as usize, last: last as usize })
        } else {
            None
        }
    }
}

/// The alphas of one vector of pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Alphas<S: Simd> {
    /// Distance to the row's peak, pixels.
    pub(super) u: S::f32s,
    /// Alpha before it is capped.
    pub(super) uncapped: S::f32s,
    /// `min(ALPHA_MAX, uncapped)`.
    pub(super) alpha: S::f32s,
    /// Lanes in which alpha reaches its minimum.
    pub(super) drawn: S::m32s,
}

/// Values that stay the same for a whole tile.
#[derive(Clone, Copy, Debug)]
pub(super) struct Broadcast<S: Simd> {
    pub(super) alpha_max: S::f32s,
    alpha_min: S::f32s,
}

impl<S: Simd> Broadcast<S> {
    #[inline(always)]
    pub(super) fn new(simd: S) -> Self {
        Self { alpha_max: simd.splat_f32s(ALPHA_MAX), alpha_min: simd.splat_f32s(ALPHA_MIN) }
    }

    /// Alphas of the pixels of vector `chunk` of the row.
    #[inline(always)]
    pub(super) fn alphas(&self, simd: S, span: &RowSpan, curve_u: f32, chunk: usize) -> Alphas<S> {
        let centres = S::as_simd_f32s(&PIXEL_CENTRES).0[chunk];
        let u = simd.sub_f32s(centres, simd.splat_f32s(span.peak_x));
        let slope = simd.mul_f32s(simd.splat_f32s(curve_u), u);
        let uncapped = exp2(simd, simd.mul_add_f32s(slope, u, simd.splat_f32s(span.peak_log2)));
        // The second argument of the minimum is returned when it is NaN: what is no number is not drawn.
        let alpha = simd.min_f32s(self.alpha_max, uncapped);
        Alphas { u, uncapped, alpha, drawn: simd.greater_than_or_equal_f32s(alpha, self.alpha_min) }
    }
}
