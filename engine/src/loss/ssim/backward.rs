//! From slopes at the window centres back to the pixels, one row at a time.

use pulp::{Simd, WithSimd};

use super::window::{WINDOW, covering_starts, horizontal, load, store};

/// The window's transpose along a row: from window centres back to the pixels of the image row.
pub(super) struct SpreadRow<'a> {
    /// Weights along the row.
    pub(super) window: &'a [f32; WINDOW],
    /// [`MARGIN`] zeros, the slopes, [`MARGIN`] zeros.
    pub(super) slopes: &'a [f32],
    /// Result, `[W, 3]`.
    pub(super) spread: &'a mut [f32],
}

impl WithSimd for SpreadRow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let window = self.window.map(|w| simd.splat_f32s(w));
        for start in covering_starts::<S>(self.spread.len()) {
            let sum = horizontal(simd, &window, self.slopes, start);
            store::<S>(self.spread, start, sum);
        }
    }
}

/// The window's transpose along the columns, and the sum of the three ways in which a rendered value acts.
pub(super) struct GatherRow<'a> {
    /// Weights of the rows of `spread`, at most eleven.
    pub(super) window: &'a [f32],
    /// Rows of window centres that see this image row, `[rows, 3, 3 W]`: spread slopes by `E[b]`, `E[d^2]`, `E[b^2]`.
    pub(super) spread: &'a [f32],
    /// Row of the truth, `[W, 3]`.
    pub(super) truth: &'a [f32],
    /// Row of the rendered image, `[W, 3]`.
    pub(super) rendered: &'a [f32],
    /// Result, `[W, 3]`: `G^T[by mean] + 2 d G^T[by d^2] + 2 b G^T[by b^2]`.
    pub(super) gradient: &'a mut [f32],
}

impl WithSimd for GatherRow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let two = simd.splat_f32s(2.0);
        let len = self.truth.len();
        for start in covering_starts::<S>(len) {
            let zero = simd.splat_f32s(0.0);
            let (mut mean, mut square, mut energy) = (zero, zero, zero);
            for (rows, &weight) in self.spread.chunks_exact(3 * len).zip(self.window) {
                let weight = simd.splat_f32s(weight);
                mean = simd.mul_add_e_f32s(weight, load::<S>(rows, start), mean);
                square = simd.mul_add_e_f32s(weight, load::<S>(rows, len + start), square);
                energy = simd.mul_add_e_f32s(weight, load::<S>(rows, 2 * len + start), energy);
            }
            let b = load::<S>(self.rendered, start);
            let d = simd.sub_f32s(b, load::<S>(self.truth, start));
            let by_squares = simd.mul_add_e_f32s(d, square, simd.mul_f32s(b, energy));
            store::<S>(self.gradient, start, simd.mul_add_e_f32s(two, by_squares, mean));
        }
    }
}
