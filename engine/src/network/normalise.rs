//! Attributes, times and velocities at a common scale, and residuals back at theirs.

use crate::gaussians::{GaussianSet, LOG_SCALE, LOGIT_COLOUR, LOGIT_OPACITY, MEAN, NUM_ATTRIBUTES, QUAT, RawGradient};
use crate::parallel;

/// Columns of the input of a first prediction: attributes and time.
pub const INITIAL_INPUTS: usize = NUM_ATTRIBUTES + 1;
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
pub(super) const VELOCITY_SCALE: f32 = 10.0;
/// What an output of 1 changes a logarithm or logit by.
pub(super) const LOGIT_RESIDUAL: f32 = 0.5;
/// What an output of 1 changes an attribute by: the Gaussian's own size, 0.1 of a quaternion, 0.5 of a logarithm or logit.
const RESIDUAL_SCALE: [f32; NUM_ATTRIBUTES] = {
    let mut scale = [LOGIT_RESIDUAL; NUM_ATTRIBUTES];
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
/// Rows of one piece of work.
const PIECE: usize = 1024;

/// Rows `[n, INITIAL_INPUTS]` of `chosen` Gaussians.
pub fn initial_rows(set: &GaussianSet, chosen: &[usize]) -> Vec<f32> {
    rows(chosen, INITIAL_INPUTS, |i, row| state(set, i, row))
}

/// What an output of 1 changes an attribute of this Gaussian by.
fn residual_scale(row: &[f32; NUM_ATTRIBUTES]) -> [f32; NUM_ATTRIBUTES] {
    let (mut scale, size) = (RESIDUAL_SCALE, size(row));
    scale[MEAN].iter_mut().for_each(|s| *s *= size);
    scale
}

/// Distance from the clip's origin along an axis beyond which no residual carries a Gaussian, metres.
const REACH: f32 = 10_000.0;

/// Geometric mean of the two largest scales, metres: how wide it looks, however thin it is.
pub(super) fn size(row: &[f32; NUM_ATTRIBUTES]) -> f32 {
    let scales = &row[LOG_SCALE];
    let thinnest = scales.iter().copied().fold(f32::INFINITY, f32::min);
    (0.5 * (scales.iter().sum::<f32>() - thinnest)).exp().clamp(SIZES[0], SIZES[1])
}

/// Gaussians that were left as they were instead of taking a residual.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// They would get a value that is not finite.
    pub not_finite: Vec<usize>,
    /// They would be carried away farther than the voxel grid may reach.
    pub carried_away: Vec<usize>,
}

/// Adds head outputs to `chosen` Gaussians, but for those that this would spoil.
///
/// # Shapes
/// `outputs` `[n, 14]`, or `[n, 17]` with velocities behind the attributes.
#[must_use]
pub(crate) fn add_residuals(set: &mut GaussianSet, chosen: &[usize], outputs: &[f32], width: usize) -> LeftOut {
    let mut left_out = LeftOut::default();
    for (&i, output) in chosen.iter().zip(outputs.chunks_exact(width)) {
        let scales = residual_scale(&set.attributes[i]);
        let (mut row, mut velocity) = (set.attributes[i], set.velocities[i]);
        for (value, (o, scale)) in row.iter_mut().zip(output.iter().zip(scales)) {
            *value += o * scale;
        }
        for (value, o) in velocity.iter_mut().zip(&output[NUM_ATTRIBUTES..]) {
            *value += o * VELOCITY_RESIDUAL;
        }
        if !row.iter().chain(&velocity).all(|value| value.is_finite()) {
            left_out.not_finite.push(i);
        } else if is_carried_away(&set.attributes[i][MEAN], &row[MEAN]) {
            left_out.carried_away.push(i);
        } else {
            (set.attributes[i], set.velocities[i]) = (row, velocity);
        }
    }
    left_out
}

/// Whether a mean leaves the scene: the voxel grid ends somewhere behind it.
pub(crate) fn is_carried_away(before: &[f32], after: &[f32]) -> bool {
    after.iter().zip(before).any(|(after, before)| after.abs() > REACH.max(before.abs()))
}

/// Gradients of a scalar by head outputs, from its gradients by the Gaussians that `add_residuals` made of them and of `set`.
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

pub(super) fn rows(chosen: &[usize], width: usize, fill: impl Fn(usize, &mut [f32]) + Sync) -> Vec<f32> {
    let mut rows = vec![0.0_f32; chosen.len() * width];
    parallel::for_chunks(&mut rows, PIECE * width, &|piece, rows| {
        rows.chunks_exact_mut(width).zip(&chosen[piece * PIECE..]).for_each(|(row, &i)| fill(i, row));
    });
    rows
}

pub(super) fn state(set: &GaussianSet, i: usize, row: &mut [f32]) {
    for (slot, (v, (centre, scale))) in row.iter_mut().zip(set.attributes[i].iter().zip(ATTRIBUTE_SCALE)) {
        *slot = (v - centre) / scale;
    }
    row[NUM_ATTRIBUTES] = set.times[i];
}

#[cfg(test)]
mod tests {
    use super::{LeftOut, NUM_ATTRIBUTES, REACH, add_residuals, residual_gradients};
    use crate::network::samples::{gradient, set, value};

    #[test]
    fn what_would_not_be_finite_stays_as_it_is() {
        let (before, width) = (set(4), NUM_ATTRIBUTES + 3);
        let mut outputs = vec![0.25; 4 * width];
        outputs[width + 2] = f32::NAN;
        outputs[2 * width + 15] = f32::MAX;
        let mut after = before.clone();
        assert_eq!(add_residuals(&mut after, &[0, 1, 2, 3], &outputs, width).not_finite, [1, 2]);
        for i in 0..4 {
            assert_eq!(after.attributes[i] == before.attributes[i], i == 1 || i == 2, "Gaussian {i}");
        }
        assert!(after.check_finite().is_ok());
    }

    #[test]
    fn what_would_be_carried_away_stays_where_it_is() {
        let width = NUM_ATTRIBUTES;
        let mut before = set(3);
        before.attributes[1][0] = -2.0 * REACH;
        before.attributes[2][0] = 2.0 * REACH;
        let mut outputs = vec![0.0; 3 * width];
        outputs[0] = 1e6 * REACH;
        // Back towards the scene, and farther away from it.
        outputs[width] = 1e4;
        outputs[2 * width] = 1e4;
        let mut after = before.clone();
        assert_eq!(add_residuals(&mut after, &[0, 1, 2], &outputs, width).carried_away, [0, 2]);
        assert!(after.attributes[1][0] > before.attributes[1][0]);
        assert_eq!(after.attributes[2], before.attributes[2]);
    }

    /// `<gradient, update(outputs) - set> = <residual gradient, outputs>`: the update is linear in the outputs.
    #[test]
    fn gradients_of_residuals_are_the_transpose_of_their_update() {
        let (before, chosen, width) = (set(6), [1, 2, 5], NUM_ATTRIBUTES + 3);
        let outputs: Vec<f32> = (0..chosen.len() * width).map(|k| value(k + 3)).collect();
        let mut after = before.clone();
        assert_eq!(add_residuals(&mut after, &chosen, &outputs, width), LeftOut::default());
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
}
