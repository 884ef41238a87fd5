//! Per-scene optimisation: Adam on the raw parameters, the refinement that needs no trained network.

mod rates;

use lgs_formats::casts::to_f32;
use rayon::prelude::*;

use super::{KnownObjective, RefineSeconds, view_schedule::ViewSchedule, zero_non_finite};
use crate::gaussians::{GaussianSet, NUM_ATTRIBUTES};
use crate::loss::LossWeights;
use crate::objective::{Wanted, objective_with};
use crate::render::Device;
use crate::views::View;

pub use rates::{AdamRates, RateGroup};

/// Decay of the mean of the gradients, and that of one with a warm start.
const BETA_1: [f64; 2] = [0.9, 0.8];
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
    pub schedule: ViewSchedule,
    /// Whether the scene is near its optimum, so that the first steps are short: see [`Adam`].
    pub warm_start: bool,
    /// Where views are drawn.
    pub device: Device,
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
/// One with a warm start has `m <- 0.8 m + 0.2 g`, leaves m its bias, and has rates of `1.5 / sqrt(1 + k / 2)` times the usual ones in step k: its steps
/// begin at a quarter of the rate, are longest in the seventh, and grow shorter. Usual first steps go by the sign of the gradient, a whole rate each,
/// which helps a scene that is far from its optimum and spoils one that is not: `measure/NEEDS.md` has the figures.
///
/// # Source
/// Kingma and Ba, Adam, 2015; Kerbl et al., 3D Gaussian splatting, 2023.
#[derive(Clone, Debug)]
pub struct Adam {
    settings: AdamSettings,
    /// `[N, 17, 2]` first and second moments.
    moments: Vec<[[f32; 2]; VARIABLES]>,
    /// Loss and gradient of the scene as it is, where they are known.
    measured: Option<KnownObjective>,
    summary: AdamSummary,
}

impl Adam {
    /// An optimisation of `num_gaussians` that has not begun.
    pub fn new(num_gaussians: usize, settings: AdamSettings) -> Self {
        let moments = vec![[[0.0; 2]; VARIABLES]; num_gaussians];
        Self { settings, moments, measured: None, summary: AdamSummary::default() }
    }

    /// Takes the next step by loss and gradient of the scene that are known already: those over the views that it would look at.
    pub(crate) fn begin_with(&mut self, measured: Option<KnownObjective>) {
        self.measured = measured;
    }

    /// Whether the next step draws the views.
    pub const fn draws(&self) -> bool {
        self.measured.is_none()
    }

    /// The loss before the step over the views that it looked at; moves both branches, and the velocities of the `LiDAR` branch.
    pub fn step(&mut self, set: &mut GaussianSet, views: &[&View]) -> f64 {
        let done = self.summary.losses.len();
        let mut current = match self.measured.take() {
            Some(measured) => measured.objective,
            None => {
                let chosen = self.settings.schedule.of_step(done, views);
                let wanted = Wanted { gradient: true, device: self.settings.device, ..Wanted::default() };
                let found = objective_with(set, &chosen, &LossWeights::default(), wanted);
                self.summary.seconds.render += found.seconds.render;
                self.summary.seconds.loss += found.seconds.loss;
                found
            }
        };
        self.summary.non_finite_gradients += zero_non_finite(&mut current.gradient);
        self.summary.losses.push(current.loss);
        let rates = self.settings.rates.by_variable();
        let pace = Pace::of_step(done, self.settings.warm_start);
        let values = set.attributes.par_iter_mut().zip(&mut set.velocities);
        let gradients = current.gradient.attributes.par_iter().zip(&current.gradient.velocities);
        let all = values.zip(gradients).zip(&mut self.moments).with_min_len(GRAIN);
        all.for_each(|(((row, velocity), (by_row, by_velocity)), moments)| {
            let all = row.iter_mut().chain(velocity).zip(by_row.iter().chain(by_velocity));
            for ((value, &gradient), (moment, rate)) in all.zip(moments.iter_mut().zip(&rates)) {
                *value -= to_f32(rate * pace.step(moment, f64::from(gradient)));
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

/// How a step goes from its gradient.
#[derive(Clone, Copy, Debug)]
struct Pace {
    beta_1: f64,
    /// What the moments are divided by.
    unbiased: [f64; 2],
    /// What the usual rates are multiplied by.
    rate: f64,
}

impl Pace {
    /// That of the step after `done` ones.
    fn of_step(done: usize, warm_start: bool) -> Self {
        let step = (done + 1) as f64;
        let second = 1.0 - BETA_2.powf(step);
        if warm_start {
            Self { beta_1: BETA_1[1], unbiased: [1.0, second], rate: 1.5 / (1.0 + step / 2.0).sqrt() }
        } else {
            Self { beta_1: BETA_1[0], unbiased: [1.0 - BETA_1[0].powf(step), second], rate: 1.0 }
        }
    }

    /// The step for a usual rate of 1; moves the moments on.
    fn step(&self, moment: &mut [f32; 2], gradient: f64) -> f64 {
        let first = self.beta_1 * f64::from(moment[0]) + (1.0 - self.beta_1) * gradient;
        let second = BETA_2 * f64::from(moment[1]) + (1.0 - BETA_2) * gradient * gradient;
        *moment = [to_f32(first), to_f32(second)];
        // Squares of small gradients leave the range of f32: a zero second moment means that there is nothing to go by.
        let root = (f64::from(moment[1]) / self.unbiased[1]).sqrt();
        if root > 0.0 { self.rate * first / self.unbiased[0] / (root + EPSILON) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_is_one_rate_against_the_gradient_whatever_its_size() {
        let first = Pace::of_step(0, false);
        for gradient in [1e-12, 1e-3, 40.0] {
            let step = first.step(&mut [0.0; 2], gradient);
            assert!((step - 1.0).abs() < 1e-3, "{gradient}: {step}");
            assert!((first.step(&mut [0.0; 2], -gradient) + 1.0).abs() < 1e-3);
        }
        assert_eq!(first.step(&mut [0.0; 2], 0.0), 0.0);
    }

    #[test]
    fn gentle_steps_begin_at_a_quarter_of_the_rate_and_are_longest_in_the_seventh() {
        let mut moment = [0.0; 2];
        let steps: Vec<f64> = (0..100).map(|done| Pace::of_step(done, true).step(&mut moment, 2.0)).collect();
        assert!((steps[0] - 0.245).abs() < 1e-3, "{}", steps[0]);
        assert!(steps[..7].is_sorted() && steps[6..].is_sorted_by(|a, b| a >= b), "{steps:?}");
        assert!((0.2..0.6).contains(&steps[6]) && (0.2..0.3).contains(&steps[99]), "{steps:?}");
    }

    #[test]
    fn a_parabola_is_descended() {
        for (warm_start, steps) in [(false, 400), (true, 2000)] {
            let (mut x, mut moment) = (3.0, [0.0; 2]);
            for done in 0..steps {
                x -= 0.05 * Pace::of_step(done, warm_start).step(&mut moment, 2.0 * (x - 1.0));
            }
            assert!((x - 1.0_f64).abs() < 0.05, "{x}");
        }
    }
}
