//! Alphas that the compositing passes share, a vector of pixels at a time.

use pulp::Simd;

use super::constants::{ALPHA_MAX, ALPHA_MIN, TILE_WIDTH};
use super::spans::RowSpan;
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
