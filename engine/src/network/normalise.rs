//! Inputs of the passes: attributes, times, velocities and gradients at a common scale, and residuals back at theirs.

use candle_core::Tensor;
use rayon::prelude::*;

use crate::gaussians::{GaussianSet, LOG_SCALE, LOGIT_COLOUR, LOGIT_OPACITY, MEAN, NUM_ATTRIBUTES, QUAT, RawGradient};

/// Columns of the input of a first prediction: attributes and time.
pub const INITIAL_INPUTS: usize = NUM_ATTRIBUTES + 1;
/// Columns of the input of a refinement step: attributes, time, velocity and the gradients of attributes and velocity.
pub const REFINE_INPUTS: usize = 2 * NUM_ATTRIBUTES + 1 + 2 * 3;
/// Columns of the input of a refinement step of the background: attributes, time, gradients of attributes.
pub const BACKGROUND_REFINE_INPUTS: usize = 2 * NUM_ATTRIBUTES + 1;

/// Subtracted from an attribute, then divided by.
const ATTRIBUTE_SCALE: [(f32, f32); NUM_ATTRIBUTES] = {
    let mut scale = [(0.0, 1.0); NUM_ATTRIBUTES];
    let mut k = 0;
    while k < NUM_ATTRIBUTES {
        if k < MEAN.end {
            scale[k] = (0.0, 50.0);
        } else if k >= LOG_SCALE.start && k < LOG_SCALE.end {
            scale[k] = (-3.0, 1.5);
        } else if k == LOGIT_OPACITY || k >= LOGIT_COLOUR.start {
            scale[k] = (0.0, 2.0);
        }
        k += 1;
    }
    scale
};
/// Metres a second that become 1.
const VELOCITY_SCALE: f32 = 10.0;
/// What an output of 1 changes an attribute by: the Gaussian's own size, 0.1 of a quaternion, 0.5 of a logarithm or logit.
const RESIDUAL_SCALE: [f32; NUM_ATTRIBUTES] = {
    let mut scale = [0.5; NUM_ATTRIBUTES];
    let mut k = 0;
    while k < QUAT.end {
        scale[k] = if k < MEAN.end { 1.0 } else { 0.1 };
        k += 1;
    }
    scale
};
/// What an output of 1 changes a velocity by, metres a second.
const VELOCITY_RESIDUAL: f32 = 3.0;
/// Bounds of the size in which positions are measured, metres.
const SIZES: [f32; 2] = [1e-3, 10.0];

/// Rows `[n, INITIAL_INPUTS]` of `chosen` Gaussians.
pub fn initial_rows(set: &GaussianSet, chosen: &[usize]) -> Vec<f32> {
    rows(chosen, INITIAL_INPUTS, |i, row| state(set, i, row))
}

/// Inputs of a refinement step.
#[derive(Clone, Debug)]
pub struct RefineRows {
    /// `[n, REFINE_INPUTS]`, or `[n, BACKGROUND_REFINE_INPUTS]` without velocities: what the U-Net is given, averaged by voxel.
    pub inputs: Vec<f32>,
    /// `[n, gradients]` the trailing columns of `inputs`: what every point adds to its voxel's features.
    pub own: Vec<f32>,
}

/// Inputs of a refinement step of `chosen` Gaussians.
///
/// # Formula
/// A gradient enters as `asinh(g / mean |g|)`, the mean taken per dimension over the rows: it does not change when the loss is
/// multiplied by a constant, and outliers, which reach hundreds of times the root mean square, do not make the others vanish. Positions are
/// measured in the Gaussian's own size, so that near and far ones are alike.
pub fn refine_rows(set: &GaussianSet, gradient: &RawGradient, chosen: &[usize], with_velocities: bool) -> RefineRows {
    let of = |i: usize| {
        let size = size(&set.attributes[i]);
        let mut row = [0.0; NUM_ATTRIBUTES + 3];
        row[..NUM_ATTRIBUTES].copy_from_slice(&gradient.attributes[i]);
        row[MEAN].iter_mut().for_each(|g| *g *= size);
        row[NUM_ATTRIBUTES..].copy_from_slice(&gradient.velocities[i]);
        row
    };
    let num_own = if with_velocities { NUM_ATTRIBUTES + 3 } else { NUM_ATTRIBUTES };
    let inverse = inverse_mean(chosen.iter().map(|&i| of(i)));
    let own = rows(chosen, num_own, |i, row| {
        row.iter_mut().zip(of(i).iter().zip(inverse)).for_each(|(slot, (&g, inverse))| *slot = scaled(g, inverse));
    });
    let width = if with_velocities { REFINE_INPUTS } else { BACKGROUND_REFINE_INPUTS };
    let mut inputs = rows(chosen, width, |i, row| {
        state(set, i, row);
        if with_velocities {
            let slots = row[INITIAL_INPUTS..].iter_mut();
            slots.zip(set.velocities[i]).take(3).for_each(|(slot, v)| *slot = v / VELOCITY_SCALE);
        }
    });
    for (row, own) in inputs.chunks_exact_mut(width).zip(own.chunks_exact(num_own)) {
        row[width - num_own..].copy_from_slice(own);
    }
    RefineRows { inputs, own }
}

/// What an output of 1 changes an attribute of this Gaussian by.
fn residual_scale(row: &[f32; NUM_ATTRIBUTES]) -> [f32; NUM_ATTRIBUTES] {
    let (mut scale, size) = (RESIDUAL_SCALE, size(row));
    scale[MEAN].iter_mut().for_each(|s| *s *= size);
    scale
}

/// Geometric mean of the three scales, metres.
fn size(row: &[f32; NUM_ATTRIBUTES]) -> f32 {
    (row[LOG_SCALE].iter().sum::<f32>() / 3.0).exp().clamp(SIZES[0], SIZES[1])
}

/// Adds head outputs to `chosen` Gaussians.
///
/// # Shapes
/// `outputs` `[n, 14]`, or `[n, 17]` with velocities behind the attributes.
pub fn add_residuals(set: &mut GaussianSet, chosen: &[usize], outputs: &[f32], width: usize) {
    for (&i, output) in chosen.iter().zip(outputs.chunks_exact(width)) {
        let scales = residual_scale(&set.attributes[i]);
        for (value, (o, scale)) in set.attributes[i].iter_mut().zip(output.iter().zip(scales)) {
            *value += o * scale;
        }
        for (value, o) in set.velocities[i].iter_mut().zip(&output[NUM_ATTRIBUTES..]) {
            *value += o * VELOCITY_RESIDUAL;
        }
    }
}

/// Gradients of a scalar by head outputs, from its gradients by the Gaussians that [`add_residuals`] made of them and of `set`.
///
/// # Shapes
/// `gradient` of the whole set; result `[n, width]`.
///
/// # Gradient
/// Exact; the sizes before the update are constants.
pub fn residual_gradients(set: &GaussianSet, chosen: &[usize], gradient: &RawGradient, width: usize) -> Vec<f32> {
    rows(chosen, width, |i, row| {
        let scales = residual_scale(&set.attributes[i]);
        for (slot, (g, scale)) in row.iter_mut().zip(gradient.attributes[i].iter().zip(scales)) {
            *slot = g * scale;
        }
        for (slot, g) in row[NUM_ATTRIBUTES..].iter_mut().zip(gradient.velocities[i]) {
            *slot = g * VELOCITY_RESIDUAL;
        }
    })
}

/// As [`add_residuals`] for all Gaussians of a branch that moves, differentiable: attributes and velocities after the update.
///
/// # Shapes
/// `attributes` `[N, 14]`, `velocities` `[N, 3]`, `outputs` `[N, 17]`.
///
/// # Gradient
/// By all three; the sizes before the update are constants.
///
/// # Errors
/// When a shape does not fit.
pub fn with_residuals(attributes: &Tensor, velocities: &Tensor, outputs: &Tensor) -> candle_core::Result<[Tensor; 2]> {
    let values = attributes.flatten_all()?.to_vec1::<f32>()?;
    let scales: Vec<f32> = values.as_chunks::<NUM_ATTRIBUTES>().0.iter().flat_map(residual_scale).collect();
    let scales = Tensor::from_vec(scales, attributes.shape(), outputs.device())?;
    let by_attribute = (outputs.narrow(1, 0, NUM_ATTRIBUTES)? * scales)?;
    let by_velocity = (outputs.narrow(1, NUM_ATTRIBUTES, 3)? * f64::from(VELOCITY_RESIDUAL))?;
    Ok([(attributes + by_attribute)?, (velocities + by_velocity)?])
}

fn rows(chosen: &[usize], width: usize, fill: impl Fn(usize, &mut [f32]) + Sync) -> Vec<f32> {
    let mut rows = vec![0.0_f32; chosen.len() * width];
    rows.par_chunks_exact_mut(width).with_min_len(1024).zip(chosen).for_each(|(row, &i)| fill(i, row));
    rows
}

fn state(set: &GaussianSet, i: usize, row: &mut [f32]) {
    for (slot, (v, (centre, scale))) in row.iter_mut().zip(set.attributes[i].iter().zip(ATTRIBUTE_SCALE)) {
        *slot = (v - centre) / scale;
    }
    row[NUM_ATTRIBUTES] = set.times[i];
}

fn scaled(gradient: f32, inverse: f64) -> f32 {
    single(asinh(f64::from(gradient) * inverse))
}

/// The inverse hyperbolic sine to more digits than f32 holds; faster than the standard library's, which is exact to the last of f64.
fn asinh(x: f64) -> f64 {
    let a = x.abs();
    // Below the bound the logarithm would lose digits, and the next term of the series is less than f32 can tell.
    let value = if a < 1e-4 { a } else { (a + a.mul_add(a, 1.0).sqrt()).ln() };
    value.copysign(x)
}

/// One over the mean magnitude of every column; 0 where a column is zero.
fn inverse_mean<const D: usize>(rows: impl ExactSizeIterator<Item = [f32; D]>) -> [f64; D] {
    let (mut sums, count) = ([0.0_f64; D], rows.len() as f64);
    for row in rows {
        sums.iter_mut().zip(row).for_each(|(s, v)| *s += f64::from(v).abs());
    }
    sums.map(|s| if s > 0.0 { count / s } else { 0.0 })
}

#[expect(clippy::cast_possible_truncation, reason = "network inputs are f32")]
fn single(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests {
    use super::{GaussianSet, NUM_ATTRIBUTES, RawGradient, add_residuals, refine_rows, residual_gradients};

    fn value(k: usize) -> f32 {
        ((k * 37 + 11) % 101) as f32 / 101.0 - 0.5
    }

    fn set(n: usize) -> GaussianSet {
        GaussianSet {
            attributes: (0..n).map(|i| std::array::from_fn(|k| 4.0 * value(i * 14 + k))).collect(),
            times: vec![0.0; n],
            velocities: (0..n).map(|i| std::array::from_fn(|k| value(i * 3 + k + 5))).collect(),
            num_lidar: n,
        }
    }

    fn gradient(n: usize, factor: f32) -> RawGradient {
        RawGradient {
            attributes: (0..n).map(|i| std::array::from_fn(|k| factor * value(i * 14 + k + 9))).collect(),
            velocities: (0..n).map(|i| std::array::from_fn(|k| factor * value(i * 3 + k + 2))).collect(),
        }
    }

    #[test]
    fn asinh_is_that_of_the_standard_library_in_f32() {
        for i in 0..4000 {
            let x = 10.0_f64.powf(f64::from(i) / 100.0 - 20.0);
            for x in [x, -x] {
                let (got, want) = (super::asinh(x), x.asinh());
                assert!((got - want).abs() <= 1e-8 * want.abs(), "{x}: {got} {want}");
            }
        }
        assert!(super::asinh(f64::NAN).is_nan() && super::asinh(0.0) == 0.0);
    }

    /// `<gradient, update(outputs) - set> = <residual gradient, outputs>`: the update is linear in the outputs.
    #[test]
    fn gradients_of_residuals_are_the_transpose_of_their_update() {
        let (before, chosen, width) = (set(6), [1, 2, 5], NUM_ATTRIBUTES + 3);
        let outputs: Vec<f32> = (0..chosen.len() * width).map(|k| value(k + 3)).collect();
        let mut after = before.clone();
        add_residuals(&mut after, &chosen, &outputs, width);
        let g = gradient(6, 1.0);
        let moved = |a: &[f32], b: &[f32], g: &[f32]| {
            a.iter().zip(b).zip(g).map(|((a, b), g)| f64::from(a - b) * f64::from(*g)).sum::<f64>()
        };
        let got: f64 = (0..6)
            .map(|i| {
                moved(&after.attributes[i], &before.attributes[i], &g.attributes[i])
                    + moved(&after.velocities[i], &before.velocities[i], &g.velocities[i])
            })
            .sum();
        let by_outputs = residual_gradients(&before, &chosen, &g, width);
        let want: f64 = by_outputs.iter().zip(&outputs).map(|(v, o)| f64::from(*v) * f64::from(*o)).sum();
        assert!((got - want).abs() < 1e-4 * want.abs().max(1.0), "{got} {want}");
    }

    #[test]
    fn the_scale_of_the_loss_does_not_matter() {
        let (set, chosen) = (set(8), [0, 2, 3, 7]);
        let plain = refine_rows(&set, &gradient(8, 1.0), &chosen, true);
        for factor in [1e-6, 1e6] {
            let scaled = refine_rows(&set, &gradient(8, factor), &chosen, true);
            assert!(plain.own.iter().zip(&scaled.own).all(|(a, b)| (a - b).abs() < 1e-4));
        }
        let tail = |row: &[f32]| row[row.len() - 17..].to_vec();
        let tails: Vec<f32> = plain.inputs.chunks_exact(super::REFINE_INPUTS).flat_map(tail).collect();
        assert_eq!(tails, plain.own);
        let none = refine_rows(&set, &gradient(8, 0.0), &chosen, false);
        assert!(none.own.iter().all(|v| *v == 0.0) && none.own.len() == 4 * NUM_ATTRIBUTES);
    }
}
