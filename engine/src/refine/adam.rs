//! Per-scene optimisation: Adam on the raw parameters, the refinement that needs no trained network.

mod rates;

use rayon::prelude::*;

use super::{RefineSeconds, silence, turns::Turns};
use crate::gaussians::{GaussianSet, NUM_ATTRIBUTES};
use crate::loss::LossWeights;
use crate::objective::objective;
use crate::views::{View, to_f32};

pub use rates::{AdamRates, RateGroup};

/// Decay of the mean of the gradients.
const BETA_1: f64 = 0.9;
/// Decay of the mean of their squares.
const BETA_2: f64 = 0.999;
/// Relative to the square root of the second moment: small, because gradients of a mean over pixels are small themselves.
const EPSILON: f64 = 1e-15;
/// Attributes and velocity of one Gaussian.
const VARIABLES: usize = NUM_ATTRIBUTES + 3;
/// Gaussians that a thread takes at once.
const GRAIN: usize = 4096;

/// How a scene is optimised.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AdamSettings {
    /// Step sizes.
    pub rates: AdamRates,
    /// Views that a step looks at.
    pub turns: Turns,
    /// Whether the scene is near its optimum, so that the first steps are short: see [`Adam`].
    pub gentle: bool,
}

/// What an optimisation did.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct AdamSummary {
    /// Loss before each step over the views that it looked at.
    pub losses: Vec<f64>,
    /// Gaussians whose gradient was not finite and was taken as zero, over all steps.
    pub non_finite_gradients: usize,
    /// What it took; no result, so not part of what is written of one.
    #[serde(skip)]
    pub seconds: RefineSeconds,
}

/// An optimisation between two of its steps.
///
/// # Formula
/// `m <- 0.9 m + 0.1 g`, `s <- 0.999 s + 0.001 g^2`, `x <- x - rate m' / (sqrt(s') + 1e-15)` with the moments' bias taken out. A value
/// without gradient so far stays where it is.
///
/// A gentle one leaves the bias of m: its steps rise from a tenth of the rate. Usual first steps go by the sign of the gradient, a whole rate each,
/// which helps a scene that is far from its optimum and spoils one that is not. Held-out PSNR after three learned steps and 0, 1, 3, 5, 15 of
/// these: on a validation scene 40.24, 30.11, 35.07, 36.10, 40.41 dB as usual, 40.24, 40.34, 40.60, 40.84, 41.56 dB gently; on `kitti_sfnd` 22.61,
/// 22.20, 22.68, 22.85, 23.11 dB and 22.61, 22.66, 22.75, 22.80, 22.99 dB.
///
/// # Source
/// Kingma and Ba, Adam, 2015; Kerbl et al., 3D Gaussian splatting, 2023.
#[derive(Clone, Debug)]
pub struct Adam {
    settings: AdamSettings,
    /// `[N, 17, 2]` first and second moments.
    moments: Vec<[[f32; 2]; VARIABLES]>,
    summary: AdamSummary,
}

impl Adam {
    /// An optimisation of `num_gaussians` that has not begun.
    pub fn new(num_gaussians: usize, settings: AdamSettings) -> Self {
        let moments = vec![[[0.0; 2]; VARIABLES]; num_gaussians];
        Self { settings, moments, summary: AdamSummary::default() }
    }

    /// The loss before the step over the views that it looked at; moves both branches, and the velocities of the `LiDAR` branch.
    pub fn step(&mut self, set: &mut GaussianSet, views: &[&View]) -> f64 {
        let done = self.summary.losses.len();
        let chosen = self.settings.turns.of_step(done, views);
        let mut current = objective(set, &chosen, &LossWeights::default());
        self.summary.non_finite_gradients += silence(&mut current.gradient);
        self.summary.seconds.render += current.seconds.render;
        self.summary.seconds.loss += current.seconds.loss;
        self.summary.losses.push(current.loss);
        let rates = self.settings.rates.by_variable();
        let unbiased = unbiased(done, self.settings.gentle);
        let values = set.attributes.par_iter_mut().zip(&mut set.velocities);
        let gradients = current.gradient.attributes.par_iter().zip(&current.gradient.velocities);
        let all = values.zip(gradients).zip(&mut self.moments).with_min_len(GRAIN);
        all.for_each(|(((row, velocity), (by_row, by_velocity)), moments)| {
            let all = row.iter_mut().chain(velocity).zip(by_row.iter().chain(by_velocity));
            for ((value, &gradient), (moment, rate)) in all.zip(moments.iter_mut().zip(&rates)) {
                *value -= to_f32(rate * direction(moment, f64::from(gradient), unbiased));
            }
        });
        current.loss
    }

    /// What was done so far.
    pub const fn summary(&self) -> &AdamSummary {
        &self.summary
    }

    /// What was done.
    pub fn into_summary(self) -> AdamSummary {
        self.summary
    }
}

/// Optimises the scene in place over all of the views; `progress` is told the loss before each step.
pub fn adam(
    set: &mut GaussianSet,
    views: &[&View],
    rates: &AdamRates,
    steps: usize,
    mut progress: impl FnMut(f64),
) -> AdamSummary {
    let mut adam = Adam::new(set.len(), AdamSettings { rates: *rates, ..AdamSettings::default() });
    (0..steps).for_each(|_| progress(adam.step(set, views)));
    adam.into_summary()
}

/// What the moments after `done` steps and one more are divided by.
fn unbiased(done: usize, gentle: bool) -> [f64; 2] {
    let [first, second] = [BETA_1, BETA_2].map(|beta| 1.0 - beta.powf((done + 1) as f64));
    [if gentle { 1.0 } else { first }, second]
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
            let step = direction(&mut [0.0; 2], gradient, unbiased(0, false));
            assert!((step - 1.0).abs() < 1e-3, "{gradient}: {step}");
            assert!((direction(&mut [0.0; 2], -gradient, unbiased(0, false)) + 1.0).abs() < 1e-3);
        }
        assert_eq!(direction(&mut [0.0; 2], 0.0, [1.0, 1.0]), 0.0);
    }

    #[test]
    fn gentle_steps_rise_from_a_tenth_of_a_rate() {
        let mut moment = [0.0; 2];
        for done in 0..60 {
            let step = direction(&mut moment, 2.0, unbiased(done, true));
            let share = 1.0 - BETA_1.powf((done + 1) as f64);
            assert!((step - share).abs() < 1e-3, "{done}: {step}");
        }
    }

    #[test]
    fn a_parabola_is_descended() {
        let (mut x, mut moment) = (3.0, [0.0; 2]);
        for done in 0..400 {
            x -= 0.05 * direction(&mut moment, 2.0 * (x - 1.0), unbiased(done, false));
        }
        assert!((x - 1.0_f64).abs() < 0.05, "{x}");
    }
}
