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
/// What an output of 1 changes an attribute by: 0.1 m, 0.1 of a quaternion, 0.5 of a logarithm, 1 of a logit.
const RESIDUAL_SCALE: [f32; NUM_ATTRIBUTES] = {
    let mut scale = [1.0; NUM_ATTRIBUTES];
    let mut k = 0;
    while k < QUAT.end {
        scale[k] = 0.1;
        k += 1;
    }
    while k < LOG_SCALE.end {
        scale[k] = 0.5;
        k += 1;
    }
    scale
};

/// Rows `[n, INITIAL_INPUTS]` of `chosen` Gaussians.
pub fn initial_rows(set: &GaussianSet, chosen: &[usize]) -> Vec<f32> {
    rows(chosen, INITIAL_INPUTS, |i, row| state(set, i, row))
}

/// Rows of a refinement step of `chosen` Gaussians, `[n, REFINE_INPUTS]` or, without velocities, `[n, BACKGROUND_REFINE_INPUTS]`.
///
/// # Formula
/// A gradient enters as `asinh(g / rms)`, the root mean square taken per dimension over the rows: it does not change when the loss is
/// multiplied by a constant, and one outlier moves the others by no more than the root of its share.
pub fn refine_rows(set: &GaussianSet, gradient: &RawGradient, chosen: &[usize], with_velocities: bool) -> Vec<f32> {
    let by_attributes = inverse_rms(chosen.iter().map(|&i| &gradient.attributes[i]));
    let by_velocities = inverse_rms(chosen.iter().map(|&i| &gradient.velocities[i]));
    let width = if with_velocities { REFINE_INPUTS } else { BACKGROUND_REFINE_INPUTS };
    rows(chosen, width, |i, row| {
        state(set, i, row);
        let mut at = INITIAL_INPUTS;
        if with_velocities {
            for (slot, v) in row[at..at + 3].iter_mut().zip(set.velocities[i]) {
                *slot = v / VELOCITY_SCALE;
            }
            at += 3;
        }
        for (slot, (g, inverse)) in row[at..].iter_mut().zip(gradient.attributes[i].iter().zip(by_attributes)) {
            *slot = scaled(*g, inverse);
        }
        if with_velocities {
            for (slot, (g, inverse)) in
                row[at + NUM_ATTRIBUTES..].iter_mut().zip(gradient.velocities[i].iter().zip(by_velocities))
            {
                *slot = scaled(*g, inverse);
            }
        }
    })
}

/// Adds head outputs to `chosen` Gaussians.
///
/// # Shapes
/// `outputs` `[n, 14]`, or `[n, 17]` with velocities behind the attributes.
pub fn add_residuals(set: &mut GaussianSet, chosen: &[usize], outputs: &[f32], width: usize) {
    for (&i, output) in chosen.iter().zip(outputs.chunks_exact(width)) {
        for (value, (o, scale)) in set.attributes[i].iter_mut().zip(output.iter().zip(RESIDUAL_SCALE)) {
            *value += o * scale;
        }
        for (value, o) in set.velocities[i].iter_mut().zip(&output[NUM_ATTRIBUTES..]) {
            *value += o * VELOCITY_SCALE;
        }
    }
}

/// As [`add_residuals`] for all Gaussians of a branch that moves, differentiable: attributes and velocities after the update.
///
/// # Shapes
/// `attributes` `[N, 14]`, `velocities` `[N, 3]`, `outputs` `[N, 17]`.
///
/// # Gradient
/// By all three.
///
/// # Errors
/// When a shape does not fit.
pub fn with_residuals(attributes: &Tensor, velocities: &Tensor, outputs: &Tensor) -> candle_core::Result<[Tensor; 2]> {
    let scale = Tensor::new(&RESIDUAL_SCALE, outputs.device())?;
    let by_attribute = outputs.narrow(1, 0, NUM_ATTRIBUTES)?.broadcast_mul(&scale)?;
    let by_velocity = (outputs.narrow(1, NUM_ATTRIBUTES, 3)? * f64::from(VELOCITY_SCALE))?;
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

fn scaled(gradient: f32, inverse_rms: f64) -> f32 {
    single((f64::from(gradient) * inverse_rms).asinh())
}

/// One over the root mean square of every column; 0 where a column is zero.
fn inverse_rms<'a, const D: usize>(rows: impl ExactSizeIterator<Item = &'a [f32; D]>) -> [f64; D] {
    let (mut sums, count) = ([0.0_f64; D], rows.len() as f64);
    for row in rows {
        sums.iter_mut().zip(row).for_each(|(s, &v)| *s += f64::from(v) * f64::from(v));
    }
    sums.map(|s| if s > 0.0 { (count / s).sqrt() } else { 0.0 })
}

#[expect(clippy::cast_possible_truncation, reason = "network inputs are f32")]
fn single(value: f64) -> f32 {
    value as f32
}
