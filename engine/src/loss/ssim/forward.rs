//! From two images to similarities and their slopes, one row of window centres at a time.

use pulp::{Simd, WithSimd};

use super::window::{MARGIN, SLACK, WINDOW, covering_starts, horizontal, load, store};

/// Stabiliser of the luminance term, `0.01^2`.
pub(in crate::loss) const C1: f32 = 1e-4;
/// Stabiliser of the contrast and structure term, `0.03^2`.
pub(in crate::loss) const C2: f32 = 9e-4;

/// Window sums of one window row along the columns: [`Moments`] from eleven rows of both images.
pub(super) struct VerticalMoments<'a> {
    /// Weights along the column.
    pub(super) window: &'a [f32; WINDOW],
    /// Rows of the truth, `[W, 3]` each.
    pub(super) truth: [&'a [f32]; WINDOW],
    /// Rows of the rendered image, `[W, 3]` each.
    pub(super) rendered: [&'a [f32]; WINDOW],
    /// Result.
    pub(super) moments: &'a mut Moments,
}

/// Weighted sums over a window (or one axis of it), of the truth `a` and the difference `d = b - a`.
///
/// Second moments of the difference instead of `E[ab]` keep the similarity of nearly equal images exact in f32. The
/// variance of the difference does not change when a constant is taken off it, so a typical value of the row is: what is
/// left is small in flat regions, where f32 would otherwise count the rounding of `E[d^2] - E[d]^2` as structure.
#[derive(Debug)]
pub(super) struct Moments {
    /// `s`, finite.
    shift: f32,
    /// `E[a]`.
    truth: Vec<f32>,
    /// `E[d - s]`.
    difference: Vec<f32>,
    /// `E[(d - s)^2]`.
    difference_square: Vec<f32>,
    /// `E[a^2 + b^2]`.
    energy: Vec<f32>,
}

impl Moments {
    /// Room for a row of `len` values.
    pub(super) fn new(len: usize) -> Self {
        let row = || vec![0.0; len + SLACK];
        Self { shift: 0.0, truth: row(), difference: row(), difference_square: row(), energy: row() }
    }
}

/// Mean difference of two rows; 0 when it is not finite.
#[inline(always)]
fn typical_difference(truth: &[f32], rendered: &[f32]) -> f32 {
    let mut sums = [0.0_f32; 16];
    for (a, b) in truth.chunks_exact(16).zip(rendered.chunks_exact(16)) {
        sums.iter_mut().zip(a.iter().zip(b)).for_each(|(sum, (a, b))| *sum += b - a);
    }
    let mean = sums.iter().sum::<f32>() / (truth.len() / 16 * 16) as f32;
    if mean.is_finite() { mean } else { 0.0 }
}

impl WithSimd for VerticalMoments<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.moments.shift = typical_difference(self.truth[WINDOW / 2], self.rendered[WINDOW / 2]);
        let shift = simd.splat_f32s(self.moments.shift);
        let window = self.window.map(|w| simd.splat_f32s(w));
        for start in covering_starts::<S>(self.truth[0].len()) {
            let zero = simd.splat_f32s(0.0);
            let (mut truth, mut difference, mut square, mut energy) = (zero, zero, zero, zero);
            for ((&weight, truth_row), rendered_row) in window.iter().zip(self.truth).zip(self.rendered) {
                let a = load::<S>(truth_row, start);
                let b = load::<S>(rendered_row, start);
                let d = simd.sub_f32s(simd.sub_f32s(b, a), shift);
                let (wa, wb, wd) = (simd.mul_f32s(weight, a), simd.mul_f32s(weight, b), simd.mul_f32s(weight, d));
                truth = simd.add_f32s(truth, wa);
                difference = simd.add_f32s(difference, wd);
                square = simd.mul_add_e_f32s(wd, d, square);
                energy = simd.mul_add_e_f32s(wb, b, simd.mul_add_e_f32s(wa, a, energy));
            }
            store::<S>(&mut self.moments.truth, start, truth);
            store::<S>(&mut self.moments.difference, start, difference);
            store::<S>(&mut self.moments.difference_square, start, square);
            store::<S>(&mut self.moments.energy, start, energy);
        }
    }
}

/// Similarity at a few window centres, and its slopes by the window sums.
struct Similarity<V> {
    value: V,
    by_mean: V,
    by_difference_square: V,
    by_energy: V,
}

/// # Formula
/// With `D1 = mu_a^2 + mu_b^2 + C1`, `D2 = var_a + var_b + C2` and `var_d = E[(d - s)^2] - E[d - s]^2`:
/// `luminance = 1 - mu_d^2 / D1`, `structure = 1 - var_d / D2`, value = their product. This equals the usual quotient.
#[inline(always)]
fn similarity<S: Simd>(simd: S, window: &[S::f32s; WINDOW], moments: &Moments, start: usize) -> Similarity<S::f32s> {
    let (one, two) = (simd.splat_f32s(1.0), simd.splat_f32s(2.0));
    let mean_a = horizontal(simd, window, &moments.truth, start);
    let shifted_mean_d = horizontal(simd, window, &moments.difference, start);
    let shifted_square_d = horizontal(simd, window, &moments.difference_square, start);
    let energy = horizontal(simd, window, &moments.energy, start);
    let mean_d = simd.add_f32s(shifted_mean_d, simd.splat_f32s(moments.shift));
    let mean_b = simd.add_f32s(mean_a, mean_d);
    let variance_d = simd.sub_f32s(shifted_square_d, simd.mul_f32s(shifted_mean_d, shifted_mean_d));
    let mean_energy = simd.mul_add_e_f32s(mean_a, mean_a, simd.mul_f32s(mean_b, mean_b));
    let inverse_1 = simd.div_f32s(one, simd.add_f32s(mean_energy, simd.splat_f32s(C1)));
    let inverse_2 = simd.div_f32s(one, simd.add_f32s(simd.sub_f32s(energy, mean_energy), simd.splat_f32s(C2)));
    let lost_1 = simd.mul_f32s(simd.mul_f32s(mean_d, mean_d), inverse_1);
    let lost_2 = simd.mul_f32s(variance_d, inverse_2);
    let (luminance, structure) = (simd.sub_f32s(one, lost_1), simd.sub_f32s(one, lost_2));
    let slope_2 = simd.mul_f32s(luminance, inverse_2);
    let slope_1 = simd.mul_f32s(structure, inverse_1);
    let luminance_by_mean = simd.mul_f32s(slope_1, simd.sub_f32s(simd.mul_f32s(mean_b, lost_1), mean_d));
    let structure_by_mean = simd.mul_f32s(slope_2, simd.sub_f32s(mean_d, simd.mul_f32s(mean_b, lost_2)));
    Similarity {
        value: simd.mul_f32s(luminance, structure),
        by_mean: simd.mul_f32s(two, simd.add_f32s(luminance_by_mean, structure_by_mean)),
        by_difference_square: simd.neg_f32s(slope_2),
        by_energy: simd.mul_f32s(slope_2, lost_2),
    }
}

/// Similarity of every window centre of one row, without slopes.
pub(super) struct RowValues<'a> {
    /// Weights along the row.
    pub(super) window: &'a [f32; WINDOW],
    /// Vertical moments of the row.
    pub(super) moments: &'a Moments,
    /// Number of values, `3 (W - 10)`.
    pub(super) len: usize,
    /// Result, `len` values and [`SLACK`].
    pub(super) values: &'a mut [f32],
}

impl WithSimd for RowValues<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let window = self.window.map(|w| simd.splat_f32s(w));
        for start in (0..self.len).step_by(S::F32_LANES) {
            let value = similarity(simd, &window, self.moments, start).value;
            store::<S>(self.values, start, value);
        }
    }
}

/// Similarity of every window centre of one row, with its slopes.
pub(super) struct RowSlopes<'a> {
    /// Weights along the row.
    pub(super) window: &'a [f32; WINDOW],
    /// Vertical moments of the row.
    pub(super) moments: &'a Moments,
    /// Number of values, `3 (W - 10)`.
    pub(super) len: usize,
    /// Similarities, `len` values and [`SLACK`].
    pub(super) values: &'a mut [f32],
    /// Slopes by `E[b]`, `E[d^2]`, `E[b^2]`, each with [`MARGIN`] zeros before and after its `len` values.
    pub(super) slopes: &'a mut [Vec<f32>; 3],
}

impl WithSimd for RowSlopes<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let window = self.window.map(|w| simd.splat_f32s(w));
        for start in (0..self.len).step_by(S::F32_LANES) {
            let at = similarity(simd, &window, self.moments, start);
            store::<S>(self.values, start, at.value);
            store::<S>(&mut self.slopes[0], MARGIN + start, at.by_mean);
            store::<S>(&mut self.slopes[1], MARGIN + start, at.by_difference_square);
            store::<S>(&mut self.slopes[2], MARGIN + start, at.by_energy);
        }
        for slopes in self.slopes {
            slopes[MARGIN + self.len..].fill(0.0);
        }
    }
}
