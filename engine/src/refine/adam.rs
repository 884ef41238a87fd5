//! Per-scene optimisation: Adam on the raw parameters, the refinement that needs no trained network.

use super::silence;
use crate::gaussians::{GaussianSet, LOG_SCALE, LOGIT_COLOUR, LOGIT_OPACITY, MEAN, NUM_ATTRIBUTES, QUAT};
use crate::loss::LossWeights;
use crate::objective::objective;
use crate::views::{View, to_f32};

/// Decay of the mean of the gradients.
const BETA_1: f64 = 0.9;
/// Decay of the mean of their squares.
const BETA_2: f64 = 0.999;
/// Relative to the square root of the second moment: small, because gradients of a mean over pixels are small themselves.
const EPSILON: f64 = 1e-15;
/// Attributes and velocity of one Gaussian.
const VARIABLES: usize = NUM_ATTRIBUTES + 3;

/// Step sizes by attribute: how far one step moves a value whose gradient keeps its sign.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamRates {
    /// Of the mean, metres.
    pub mean: f64,
    /// Of the quaternion.
    pub quat: f64,
    /// Of the log scale.
    pub log_scale: f64,
    /// Of the opacity logit.
    pub logit_opacity: f64,
    /// Of the colour logit.
    pub logit_colour: f64,
    /// Of the velocity, metres a second.
    pub velocity: f64,
}

impl Default for AdamRates {
    /// Those of 3D Gaussian splatting for rotation, scale and opacity; the mean's for scenes in metres.
    fn default() -> Self {
        Self { mean: 2e-3, quat: 1e-3, log_scale: 5e-3, logit_opacity: 5e-2, logit_colour: 2e-2, velocity: 2e-2 }
    }
}

impl AdamRates {
    fn by_variable(&self) -> [f64; VARIABLES] {
        let mut rates = [self.velocity; VARIABLES];
        rates[MEAN].fill(self.mean);
        rates[QUAT].fill(self.quat);
        rates[LOG_SCALE].fill(self.log_scale);
        rates[LOGIT_OPACITY] = self.logit_opacity;
        rates[LOGIT_COLOUR].fill(self.logit_colour);
        rates
    }
}

/// What an optimisation did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AdamSummary {
    /// Loss over the views before each step.
    pub losses: Vec<f64>,
    /// Gaussians whose gradient was not finite and was taken as zero, over all steps.
    pub non_finite_gradients: usize,
}

/// Optimises the scene in place over the views: both branches, the velocities of the `LiDAR` branch.
///
/// # Formula
/// `m <- 0.9 m + 0.1 g`, `s <- 0.999 s + 0.001 g^2`, `x <- x - rate m' / (sqrt(s') + 1e-15)` with the moments' bias taken out. A value
/// without gradient so far stays where it is.
///
/// # Source
/// Kingma and Ba, Adam, 2015; Kerbl et al., 3D Gaussian splatting, 2023.
pub fn adam(
    set: &mut GaussianSet,
    views: &[&View],
    rates: &AdamRates,
    steps: usize,
    mut progress: impl FnMut(f64),
) -> AdamSummary {
    let weights = LossWeights::default();
    let rates = rates.by_variable();
    let mut moments = vec![[[0.0_f32; 2]; VARIABLES]; set.len()];
    let mut summary = AdamSummary::default();
    for step in 1..=steps {
        let mut current = objective(set, views, &weights);
        summary.non_finite_gradients += silence(&mut current.gradient);
        summary.losses.push(current.loss);
        let unbiased = [BETA_1, BETA_2].map(|beta| 1.0 - beta.powf(step as f64));
        let gradients = current.gradient.attributes.iter().zip(&current.gradient.velocities);
        let values = set.attributes.iter_mut().zip(&mut set.velocities);
        for (((row, velocity), (by_row, by_velocity)), moments) in values.zip(gradients).zip(&mut moments) {
            let all = row.iter_mut().chain(velocity).zip(by_row.iter().chain(by_velocity));
            for ((value, &gradient), (moment, rate)) in all.zip(moments.iter_mut().zip(&rates)) {
                *value -= to_f32(rate * direction(moment, f64::from(gradient), unbiased));
            }
        }
        progress(current.loss);
    }
    summary
}

/// The step for a rate of 1; moves the moments on.
fn direction(moment: &mut [f32; 2], gradient: f64, unbiased: [f64; 2]) -> f64 {
    let first = BETA_1 * f64::from(moment[0]) + (1.0 - BETA_1) * gradient;
    let second = BETA_2 * f64::from(moment[1]) + (1.0 - BETA_2) * gradient * gradient;
    *moment = [to_f32(first), to_f32(second)];
    // Squares of small gradients leave the range of f32: a zero second moment means that there is nothing to go by.
    let root = (f64::from(moment[1]) / unbiased[1]).sqrt();
    if root > 0.0 { first / unbiased[0] / (root + EPSILON) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_is_one_rate_against_the_gradient_whatever_its_size() {
        for gradient in [1e-12, 1e-3, 40.0] {
            let unbiased = [1.0 - BETA_1, 1.0 - BETA_2];
            let step = direction(&mut [0.0; 2], gradient, unbiased);
            assert!((step - 1.0).abs() < 1e-3, "{gradient}: {step}");
            assert!((direction(&mut [0.0; 2], -gradient, unbiased) + 1.0).abs() < 1e-3);
        }
        assert_eq!(direction(&mut [0.0; 2], 0.0, [1.0, 1.0]), 0.0);
    }

    #[test]
    fn a_parabola_is_descended() {
        let (mut x, mut moment) = (3.0, [0.0; 2]);
        for step in 1..=400 {
            let unbiased = [BETA_1, BETA_2].map(|beta: f64| 1.0 - beta.powi(step));
            x -= 0.05 * direction(&mut moment, 2.0 * (x - 1.0), unbiased);
        }
        assert!((x - 1.0_f64).abs() < 0.05, "{x}");
    }
}
