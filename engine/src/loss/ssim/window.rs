//! The window, and what the row kernels share: eight or sixteen values at a time, chosen when the program runs.
//!
//! Rows are `[W, 3]` interleaved, so a step of one pixel is a step of [`CHANNELS`] values and the three channels never
//! mix. Scratch rows are longer than their content by [`SLACK`], so that whole vectors can be written past its end.

use pulp::Simd;

use lgs_formats::casts::to_f32;

/// Side of the window, pixels.
pub(in crate::loss) const WINDOW: usize = 11;
/// Standard deviation of the window, pixels.
const SIGMA: f32 = 1.5;
/// Colour channels.
pub(super) const CHANNELS: usize = 3;
/// Values by which a valid row is shorter than its image row.
pub(super) const MARGIN: usize = (WINDOW - 1) * CHANNELS;
/// Values beyond a scratch row's content: at least the lanes of the widest vector.
pub(super) const SLACK: usize = 32;

/// The window's weights along one axis. They sum to 1 beyond f32 precision: what rounding them left over is in the two
/// outermost, because a sum off by 1e-7 would count as variance in a flat region.
pub(in crate::loss) fn window() -> [f32; WINDOW] {
    let centre = (WINDOW / 2) as f32;
    let raw: [f32; WINDOW] = std::array::from_fn(|k| (-((k as f32 - centre) / SIGMA).powi(2) / 2.0).exp());
    let sum: f32 = raw.iter().sum();
    let mut weights = raw.map(|w| w / sum);
    let residual = 1.0 - weights.iter().map(|&w| f64::from(w)).sum::<f64>();
    weights[0] += to_f32(residual / 2.0);
    weights[WINDOW - 1] = weights[0];
    weights
}

/// Sum in f64, as eight sums side by side.
#[inline(always)]
pub(super) fn sum(values: &[f32]) -> f64 {
    let mut sums = [0.0_f64; 8];
    let (whole, rest) = values.as_chunks::<8>();
    for chunk in whole {
        sums.iter_mut().zip(chunk).for_each(|(sum, &value)| *sum += f64::from(value));
    }
    sums.iter().sum::<f64>() + rest.iter().map(|&value| f64::from(value)).sum::<f64>()
}

/// The vector that begins `start` values into a row.
#[inline(always)]
pub(super) fn load<S: Simd>(row: &[f32], start: usize) -> S::f32s {
    S::as_simd_f32s(&row[start..start + S::F32_LANES]).0[0]
}

/// Writes a vector `start` values into a row.
#[inline(always)]
pub(super) fn store<S: Simd>(row: &mut [f32], start: usize, value: S::f32s) {
    S::as_mut_simd_f32s(&mut row[start..start + S::F32_LANES]).0[0] = value;
}

/// Starts of the vectors that cover `len >= LANES` values without passing the end; the last two may overlap.
#[inline(always)]
pub(super) fn covering_starts<S: Simd>(len: usize) -> impl Iterator<Item = usize> {
    (0..len.div_ceil(S::F32_LANES)).map(move |i| (i * S::F32_LANES).min(len - S::F32_LANES))
}

/// Weighted sum of eleven vectors, `start` values into the row and `CHANNELS` apart.
#[inline(always)]
pub(super) fn horizontal<S: Simd>(simd: S, window: &[S::f32s; WINDOW], row: &[f32], start: usize) -> S::f32s {
    let mut sum = simd.mul_f32s(window[0], load::<S>(row, start));
    for (k, &weight) in window.iter().enumerate().skip(1) {
        sum = simd.mul_add_e_f32s(weight, load::<S>(row, start + k * CHANNELS), sum);
    }
    sum
}
