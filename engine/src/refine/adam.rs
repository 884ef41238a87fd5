//! Per-scene optimisation: Adam on the raw parameters, the refinement that needs no trained network.

#[cfg(feature = "gpu")]
mod gpu;
mod pace;
mod rates;

use lgs_formats::casts::to_f32;
use rayon::prelude::*;

use pace::Pace;

use super::{KnownObjective, RefineSeconds, view_schedule::ViewSchedule, zero_non_finite};
use crate::gaussians::{GaussianSet, NUM_ATTRIBUTES};
use crate::loss::{Kept, LossWeights};
use crate::objective::{Wanted, objective_keeping};
use crate::render::Device;
use crate::views::View;

pub use rates::{AdamRates, RateGroup};

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
/// One with a warm start has `m <- 0.6 m + 0.4 g`, leaves m its bias, and has rates of `1.5 / sqrt(1 + k / 2)` times the usual ones in step k: its steps
/// begin at half the rate, are longest in the fourth, and grow shorter. Usual first steps go by the sign of the gradient, a whole rate each,
/// which helps a scene that is far from its optimum and spoils one that is not: `measure/NEEDS.md` has the figures.
///
/// # Source
/// Kingma and Ba, Adam, 2015; Kerbl et al., 3D Gaussian splatting, 2023.
#[derive(Debug)]
pub struct Adam<'v> {
    settings: AdamSettings,
    /// `[N, 17, 2]` first and second moments, those of the steps that are not ahead on a GPU.
    moments: Vec<[[f32; 2]; VARIABLES]>,
    /// Loss and gradient of the scene as it is, where they are known.
    measured: Option<KnownObjective>,
    kept: Kept<'v>,
    /// The scene and its moments on a GPU, where steps are made there.
    #[cfg(feature = "gpu")]
    there: Option<gpu::There>,
    summary: AdamSummary,
}

impl<'v> Adam<'v> {
    /// An optimisation of `num_gaussians` that has not begun.
    pub fn new(num_gaussians: usize, settings: AdamSettings) -> Self {
        Self {
            settings,
            moments: vec![[[0.0; 2]; VARIABLES]; num_gaussians],
            measured: None,
            kept: Kept::default(),
            #[cfg(feature = "gpu")]
            there: None,
            summary: AdamSummary::default(),
        }
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
    pub fn step(&mut self, set: &mut GaussianSet, views: &[&'v View]) -> f64 {
        let loss = self.step_ahead(set, views);
        self.settle(set, views);
        loss
    }

    /// As [`Adam::step`], but that on a GPU the scene stays there: `set` is as it was, and nobody may change it, until [`Adam::settle`].
    pub fn step_ahead(&mut self, set: &mut GaussianSet, views: &[&'v View]) -> f64 {
        #[cfg(feature = "gpu")]
        if let Some(loss) = self.step_there(set, views) {
            return loss;
        }
        self.step_here(set, views)
    }

    /// Brings the scene to where the steps have led.
    pub fn settle(&mut self, set: &mut GaussianSet, views: &[&'v View]) {
        #[cfg(feature = "gpu")]
        self.settle_there(set, views);
        // Without GPUs it is there already.
        let _ = (set, views);
    }

    fn step_here(&mut self, set: &mut GaussianSet, views: &[&'v View]) -> f64 {
        let done = self.summary.losses.len();
        let mut current = match self.measured.take() {
            Some(measured) => measured.objective,
            None => {
                let chosen = self.settings.schedule.of_step(done, views);
                let wanted = Wanted { gradient: true, device: self.settings.device, ..Wanted::default() };
                let found = objective_keeping(set, &chosen, &LossWeights::default(), wanted, &mut self.kept);
                self.summary.seconds.add(found.seconds);
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
