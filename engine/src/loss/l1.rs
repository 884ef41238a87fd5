//! Mean absolute colour error.

use pulp::Arch;
use rayon::prelude::*;

use crate::parallel;

/// Values that a thread takes at a time; sums are formed per chunk, then over the chunks in order.
const CHUNK: usize = 3 * 4096;
/// Sums that run side by side within a chunk.
const LANES: usize = 8;

/// Mean of `|rendered - truth|` over `num_values` values, with `weight` times its gradient written to `gradient`.
///
/// # Shapes
/// All slices `[H, W, 3]`. `num_values` is the number of values that take part; the others must be equal in both images,
/// so that they add nothing. No value: 0, and a gradient of zeros.
///
/// # Gradient
/// `weight sign(rendered - truth) / num_values`, 0 where both are equal. A value that is not finite makes the mean not
/// finite; the gradient stays finite.
pub(super) fn l1(rendered: &[f32], truth: &[f32], num_values: usize, weight: f32, gradient: &mut [f32]) -> f64 {
    if num_values == 0 {
        gradient.fill(0.0);
        return 0.0;
    }
    let (arch, slope) = (Arch::new(), weight / num_values as f32);
    let tasks = rendered.par_chunks(CHUNK).zip(truth.par_chunks(CHUNK)).zip(gradient.par_chunks_mut(CHUNK));
    let sums: Vec<f64> = tasks.map(|((r, t), g)| arch.dispatch(|| chunk(r, t, slope, g))).collect();
    sums.iter().sum::<f64>() / num_values as f64
}

/// As [`l1`], without a gradient: the same bits.
pub(super) fn mean_difference(rendered: &[f32], truth: &[f32], num_values: usize) -> f64 {
    if num_values == 0 {
        return 0.0;
    }
    let arch = Arch::new();
    let part = |number: usize| number * CHUNK..rendered.len().min((number + 1) * CHUNK);
    let sum = |number: usize| arch.dispatch(|| chunk_sum(&rendered[part(number)], &truth[part(number)]));
    let sums = parallel::map(rendered.len().div_ceil(CHUNK), 1, &sum);
    sums.iter().sum::<f64>() / num_values as f64
}

/// Sum of the absolute differences of one chunk, with its gradient written.
#[inline(always)]
fn chunk(rendered: &[f32], truth: &[f32], slope: f32, gradient: &mut [f32]) -> f64 {
    for ((r, t), g) in rendered.iter().zip(truth).zip(gradient) {
        *g = if r - t == 0.0 { 0.0 } else { slope.copysign(r - t) };
    }
    chunk_sum(rendered, truth)
}

/// Sum of the absolute differences of one chunk.
#[inline(always)]
fn chunk_sum(rendered: &[f32], truth: &[f32]) -> f64 {
    let (rendered, rendered_rest) = rendered.as_chunks::<LANES>();
    let (truth, truth_rest) = truth.as_chunks::<LANES>();
    let mut sums = [0.0_f64; LANES];
    for (r, t) in rendered.iter().zip(truth) {
        for lane in 0..LANES {
            sums[lane] += f64::from((r[lane] - t[lane]).abs());
        }
    }
    let rest = rendered_rest.iter().zip(truth_rest);
    sums.iter().sum::<f64>() + rest.map(|(r, t)| f64::from((r - t).abs())).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The same as one plain loop.
    fn twin(rendered: &[f32], truth: &[f32], num_values: usize) -> f64 {
        rendered.iter().zip(truth).map(|(r, t)| f64::from((r - t).abs())).sum::<f64>() / num_values as f64
    }

    #[test]
    fn gradient_is_the_finite_difference_of_the_value() {
        let truth: Vec<f32> = (0..99).map(|i| (i as f32 * 0.37).sin() * 0.5 + 0.5).collect();
        let rendered: Vec<f32> = (0..99).map(|i| truth[i] + if i % 2 == 0 { 0.25 } else { -0.125 }).collect();
        let mut gradient = vec![f32::NAN; 99];
        l1(&rendered, &truth, 99, 0.5, &mut gradient);
        let step = 1.0 / 64.0;
        for i in 0..99 {
            let moved = |by: f32| {
                let mut image = rendered.clone();
                image[i] += by;
                l1(&image, &truth, 99, 0.5, &mut vec![0.0; 99])
            };
            let want = 0.5 * (moved(step) - moved(-step)) / f64::from(2.0 * step);
            assert!((f64::from(gradient[i]) - want).abs() < 1e-8, "value {i}: got {}, want {want}", gradient[i]);
        }
    }

    #[test]
    fn equal_values_have_no_slope_and_no_value_is_no_loss() {
        let mut gradient = vec![1.0; 3];
        assert_eq!(l1(&[0.5; 3], &[0.5, 0.25, 0.75], 3, 3.0, &mut gradient), 1.0 / 6.0);
        assert_eq!(gradient, [0.0, 1.0, -1.0]);
        assert_eq!(l1(&[0.5; 3], &[0.5; 3], 0, 1.0, &mut gradient), 0.0);
        assert_eq!(gradient, [0.0; 3]);
        assert_eq!(l1(&[], &[], 0, 1.0, &mut []), 0.0);
    }

    #[test]
    fn a_value_that_is_not_finite_shows_in_the_mean_only() {
        let mut gradient = vec![0.0; 3];
        assert!(l1(&[f32::NAN, 0.0, 1.0], &[0.5; 3], 3, 1.0, &mut gradient).is_nan());
        assert!(gradient.iter().all(|g| g.is_finite()));
        assert_eq!(l1(&[f32::INFINITY, 0.0, 1.0], &[0.5; 3], 3, 1.0, &mut gradient), f64::INFINITY);
    }

    proptest! {
        #[test]
        fn equals_the_plain_loop(values in prop::collection::vec((0.0_f32..1.0, 0.0_f32..1.0), 1..40_000)) {
            let (rendered, truth): (Vec<f32>, Vec<f32>) = values.into_iter().unzip();
            let got = l1(&rendered, &truth, rendered.len(), 1.0, &mut vec![0.0; rendered.len()]);
            let want = twin(&rendered, &truth, rendered.len());
            prop_assert!((got - want).abs() < 1e-12, "got {}, want {}", got, want);
        }
    }
}
