//! Comparisons that the tests of the operations share.

use candle_core::Tensor;

/// `n` repeatable values in (-1, 1).
pub(crate) fn values(n: usize, seed: u64) -> Vec<f32> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / (1_u32 << 23) as f32 - 1.0
    };
    for _ in 0..16 {
        next();
    }
    (0..n).map(|_| next()).collect()
}

/// The values in f64.
pub(crate) fn doubles(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&v| f64::from(v)).collect()
}

/// Fails with the worst value that is off by more than `tolerance` of the largest wanted value, at least of 1.
#[track_caller]
pub(crate) fn assert_close(what: &str, got: &Tensor, want: &[f64], tolerance: f64) {
    let got = got.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    assert_eq!(got.len(), want.len(), "{what}: number of values");
    let scale = want.iter().fold(1.0_f64, |all, v| all.max(v.abs()));
    let error = |i: usize| (f64::from(got[i]) - want[i]).abs() / scale;
    let worst = (0..want.len()).max_by(|&a, &b| error(a).total_cmp(&error(b)));
    if let Some(i) = worst {
        assert!(
            error(i) <= tolerance,
            "{what}[{i}]: got {}, want {}, tolerance {}",
            got[i],
            want[i],
            tolerance * scale
        );
    }
}

/// Fails where `gradient` is not the slope of `loss` at `at`, by central differences of `step`.
#[track_caller]
pub(crate) fn assert_slope(what: &str, gradient: &Tensor, at: &[f64], step: f64, loss: impl Fn(&[f64]) -> f64) {
    let slopes: Vec<f64> = (0..at.len())
        .map(|i| {
            let shifted = |by: f64| {
                let mut point = at.to_vec();
                point[i] += by;
                loss(&point)
            };
            (shifted(step) - shifted(-step)) / (2.0 * step)
        })
        .collect();
    assert_close(what, gradient, &slopes, 2e-5);
}
