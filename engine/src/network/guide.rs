//! Inputs of a refinement step: the state of the Gaussians and what tells how the rendered views differ from the input views.

use super::config::Guidance;
use super::normalise::{INITIAL_INPUTS, LOGIT_RESIDUAL, VELOCITY_SCALE, rows, size, state};
use crate::gaussians::physical::{logit, sigmoid};
use crate::gaussians::{GaussianSet, LOGIT_COLOUR, MEAN, MeanResiduals, NUM_ATTRIBUTES, QUAT, RawGradient};

/// Columns of the input of a refinement step: attributes, time, velocity and the gradients of attributes and velocity.
pub(crate) const REFINE_INPUTS: usize = 2 * NUM_ATTRIBUTES + 1 + 2 * 3;
/// Columns of the input of a refinement step of the background: attributes, time, gradients of attributes.
pub(crate) const BACKGROUND_REFINE_INPUTS: usize = 2 * NUM_ATTRIBUTES + 1;

/// Columns of the input of a refinement step: of a model that is guided by residuals [`MORE`] more.
pub(crate) const fn refine_inputs(guidance: Guidance, moving: bool) -> usize {
    let columns = if moving { REFINE_INPUTS } else { BACKGROUND_REFINE_INPUTS };
    match guidance {
        Guidance::Gradient => columns,
        Guidance::Residual => columns + MORE,
    }
}

/// Columns of the inputs of a point that are gradients.
pub(crate) const fn gradient_inputs(moving: bool) -> usize {
    if moving { NUM_ATTRIBUTES + 3 } else { NUM_ATTRIBUTES }
}

/// Columns behind mean residuals: weight, error, and the step of each colour that would take its mean error away.
const MORE: usize = 5;
/// Bounds of the colours that such a step leads to.
const COLOURS: [f32; 2] = [0.005, 0.995];
/// Largest such step, of outputs of the heads.
const MAX_COLOUR_STEP: f32 = 8.0;

/// What guides a refinement step.
#[derive(Clone, Copy, Debug)]
pub enum Guide<'a> {
    /// The gradient of the loss.
    Gradient(&'a RawGradient),
    /// The errors that every Gaussian sees.
    Residual(&'a MeanResiduals),
}

/// Rows below which every value counts for their scale.
const FEW_ROWS: usize = 16;

/// What makes the usual mean residuals about 1, by attribute and velocity: all but the smallest count by their sign and logarithm, so that a
/// Gaussian that hardly shows has its say.
const RESIDUAL_GAIN: [f64; NUM_ATTRIBUTES + 3] = {
    let mut gain = [2e3; NUM_ATTRIBUTES + 3];
    let mut k = 0;
    while k < gain.len() {
        if k < QUAT.end {
            gain[k] = 4e3;
        } else if k >= NUM_ATTRIBUTES {
            gain[k] = 2e4;
        }
        k += 1;
    }
    gain
};

/// Inputs of a refinement step.
#[derive(Clone, Debug)]
pub struct RefineRows {
    /// `[n, refine_inputs]` what the U-Net is given, averaged by voxel.
    pub inputs: Vec<f32>,
    /// `[n, gradients]` the columns of `inputs` that are gradients: what a point has beside its voxel's features.
    pub point_inputs: Vec<f32>,
}

/// Inputs of a refinement step of `chosen` Gaussians.
///
/// # Formula
/// A gradient enters as `asinh(g / mean |g|)`, the mean taken per dimension over the rows: it does not change when the loss is
/// multiplied by a constant, and outliers, which reach hundreds of times the root mean square, do not make the others vanish. Positions are
/// measured in the Gaussian's own size, so that near and far ones are alike.
///
/// Mean residuals, which have a scale of their own, enter as `asinh(k g)` with constants k, velocities in the size too; behind them
/// `ln(1 + weight) / 2`, ten times the error, and for each colour c with mean error e what the heads would have to say to make it c - e.
pub fn refine_rows(set: &GaussianSet, guide: Guide<'_>, chosen: &[usize], with_velocities: bool) -> RefineRows {
    let (guidance, gradient) = match guide {
        Guide::Gradient(gradient) => (Guidance::Gradient, gradient),
        Guide::Residual(residuals) => (Guidance::Residual, &residuals.gradient),
    };
    let gradient_row = |i: usize| {
        let size = size(&set.attributes[i]);
        let mut row = [0.0; NUM_ATTRIBUTES + 3];
        row[..NUM_ATTRIBUTES].copy_from_slice(&gradient.attributes[i]);
        row[MEAN].iter_mut().for_each(|g| *g *= size);
        row[NUM_ATTRIBUTES..].copy_from_slice(&gradient.velocities[i]);
        if guidance == Guidance::Residual {
            row[NUM_ATTRIBUTES..].iter_mut().for_each(|g| *g *= size);
        }
        row
    };
    let num_gradients = gradient_inputs(with_velocities);
    let inverse = match guidance {
        Guidance::Gradient => inverse_mean(chosen.iter().map(|&i| gradient_row(i))),
        Guidance::Residual => RESIDUAL_GAIN,
    };
    let point_inputs = rows(chosen, num_gradients, |i, row| {
        row.iter_mut()
            .zip(gradient_row(i).iter().zip(inverse))
            .for_each(|(slot, (&g, inverse))| *slot = scaled(g, inverse));
    });
    let width = refine_inputs(guidance, with_velocities);
    let first_gradient = width - num_gradients - if guidance == Guidance::Residual { MORE } else { 0 };
    let mut inputs = rows(chosen, width, |i, row| {
        state(set, i, row);
        if with_velocities {
            let slots = row[INITIAL_INPUTS..].iter_mut();
            slots.zip(set.velocities[i]).take(3).for_each(|(slot, v)| *slot = v / VELOCITY_SCALE);
        }
        if let Guide::Residual(residuals) = guide {
            row[width - MORE] = finite(residuals.weights[i].ln_1p() / 2.0);
            row[width - MORE + 1] = finite(10.0 * residuals.errors[i]);
            for (slot, k) in row[width - 3..].iter_mut().zip(LOGIT_COLOUR) {
                *slot = finite(colour_step(set.attributes[i][k], residuals.gradient.attributes[i][k]));
            }
        }
    });
    for (row, gradients) in inputs.chunks_exact_mut(width).zip(point_inputs.chunks_exact(num_gradients)) {
        row[first_gradient..first_gradient + num_gradients].copy_from_slice(gradients);
    }
    RefineRows { inputs, point_inputs }
}

/// What an output of the heads has to be so that a colour loses its mean error.
fn colour_step(colour: f32, gradient: f32) -> f32 {
    let slope = sigmoid(colour) * sigmoid(-colour);
    if gradient == 0.0 || slope == 0.0 {
        return 0.0;
    }
    let wanted = sigmoid(colour) - gradient / slope;
    let step = (logit(wanted.clamp(COLOURS[0], COLOURS[1])) - colour) / LOGIT_RESIDUAL;
    step.clamp(-MAX_COLOUR_STEP, MAX_COLOUR_STEP)
}

/// The value, or 0 in place of one that is not finite.
fn finite(value: f32) -> f32 {
    if value.is_finite() { value } else { 0.0 }
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

/// One over the mean magnitude of every column; 0 where a column is zero. One value that is more than all others together does not
/// count where there are [`FEW_ROWS`] or more: it says nothing about their scale.
fn inverse_mean<const D: usize>(rows: impl ExactSizeIterator<Item = [f32; D]> + Clone) -> [f64; D] {
    let few = rows.len() < FEW_ROWS;
    let (mut sums, mut largest, count) = ([0.0_f64; D], [0.0_f64; D], rows.len() as f64);
    for row in rows.clone() {
        for ((sum, largest), value) in sums.iter_mut().zip(&mut largest).zip(row) {
            let value = f64::from(value).abs();
            *sum += value;
            *largest = largest.max(value);
        }
    }
    let alone: [bool; D] = std::array::from_fn(|k| !few && 2.0 * largest[k] > sums[k]);
    if alone.contains(&true) {
        // Summed anew: in the sum with it, the others may be lost.
        let mut others = [0.0_f64; D];
        for row in rows {
            for ((sum, &largest), value) in others.iter_mut().zip(&largest).zip(row) {
                let value = f64::from(value).abs();
                *sum += if value < largest { value } else { 0.0 };
            }
        }
        (0..D).filter(|&k| alone[k] && others[k] > 0.0).for_each(|k| sums[k] = others[k]);
    }
    sums.map(|s| if s > 0.0 { count / s } else { 0.0 })
}

#[expect(clippy::cast_possible_truncation, reason = "network inputs are f32")]
fn single(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests {
    use super::{Guide, MORE, MeanResiduals, NUM_ATTRIBUTES, REFINE_INPUTS, refine_rows};
    use crate::network::samples::{gradient, set};

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

    #[test]
    fn the_scale_of_the_loss_does_not_matter() {
        let (set, chosen) = (set(8), [0, 2, 3, 7]);
        let plain = refine_rows(&set, Guide::Gradient(&gradient(8, 1.0)), &chosen, true);
        for factor in [1e-6, 1e6] {
            let scaled = refine_rows(&set, Guide::Gradient(&gradient(8, factor)), &chosen, true);
            assert!(plain.point_inputs.iter().zip(&scaled.point_inputs).all(|(a, b)| (a - b).abs() < 1e-4));
        }
        let tail = |row: &[f32]| row[row.len() - 17..].to_vec();
        let tails: Vec<f32> = plain.inputs.chunks_exact(REFINE_INPUTS).flat_map(tail).collect();
        assert_eq!(tails, plain.point_inputs);
        let none = refine_rows(&set, Guide::Gradient(&gradient(8, 0.0)), &chosen, false);
        assert!(none.point_inputs.iter().all(|v| *v == 0.0) && none.point_inputs.len() == 4 * NUM_ATTRIBUTES);
    }

    #[test]
    fn residuals_keep_their_scale_and_bring_weight_and_error() {
        let (set, chosen) = (set(3), [0, 1, 2]);
        let rows = |factor: f32| {
            let residuals = MeanResiduals {
                gradient: gradient(3, factor),
                weights: vec![0.0, f32::INFINITY, 6.0],
                errors: vec![0.0, f32::NAN, 0.05],
            };
            refine_rows(&set, Guide::Residual(&residuals), &chosen, true)
        };
        let (small, large) = (rows(1e-3), rows(1.0));
        assert!(small.point_inputs.iter().zip(&large.point_inputs).all(|(s, l)| s.abs() < l.abs() || *l == 0.0));
        let ends = |k: usize| small.inputs[(k + 1) * (REFINE_INPUTS + MORE) - MORE..][..2].to_vec();
        assert_eq!(ends(0), [0.0, 0.0]);
        assert_eq!(ends(1), [0.0, 0.0], "what is not finite says nothing");
        let near = |got: f32, want: f32| (got - want).abs() < 1e-6;
        assert!(near(ends(2)[0], 7.0_f32.ln() / 2.0) && near(ends(2)[1], 0.5), "{:?}", ends(2));
        assert!(small.inputs.iter().all(|v| v.is_finite()));
    }
}
