//! Values for tests.

use crate::gaussians::{GaussianSet, RawGradient};

/// From -1/2 to 1/2.
pub(super) fn value(k: usize) -> f32 {
    ((k * 37 + 11) % 101) as f32 / 101.0 - 0.5
}

/// `n` Gaussians of the `LiDAR` branch.
pub(super) fn set(n: usize) -> GaussianSet {
    GaussianSet {
        attributes: (0..n).map(|i| std::array::from_fn(|k| 4.0 * value(i * 14 + k))).collect(),
        times: vec![0.0; n],
        frames: vec![0; n],
        velocities: (0..n).map(|i| std::array::from_fn(|k| value(i * 3 + k + 5))).collect(),
        num_lidar: n,
    }
}

/// Gradients of `n` Gaussians, times `factor`.
pub(super) fn gradient(n: usize, factor: f32) -> RawGradient {
    RawGradient {
        attributes: (0..n).map(|i| std::array::from_fn(|k| factor * value(i * 14 + k + 9))).collect(),
        velocities: (0..n).map(|i| std::array::from_fn(|k| factor * value(i * 3 + k + 2))).collect(),
    }
}
