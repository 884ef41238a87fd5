//! Per-scene optimisation: Adam on the raw parameters, the refinement that needs no trained network.

#[cfg(feature = "gpu")]
mod gpu;
mod pace;
mod rates;

use lgs_formats::casts::to_f32;
use rayon::prelude::*;

use pace::Pace;

use super::{RefineSeconds, view_schedule::ViewSchedule, zero_non_finite};
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
    /// Of each pass, the mean over the views of the loss before the step that looked at them.
    pub losses: Vec<f64>,
    /// How far apart the pixels were that it drew, in columns and rows; every fourth pass drew all.
    pub pixel_stride: usize,
    /// Gaussians whose gradient was not finite and was taken as zero, over all steps.
    pub non_finite_gradients: usize,
    /// What it took; no result, so not part of what is written of one.
    #[serde(skip)]
    pub seconds: RefineSeconds,
}

/// An optimisation between two of its passes, each of which looks at every view once.
///
/// A step looks at as many views as the schedule says, and moves the Gaussians that they show: those whose attributes have a gradient that is not
/// zero. The steps of a Gaussian are counted by themselves, so that views which do not show it change nothing of it. With the same drawings, many
/// steps by a view each go farther than few by all of them: `measure/NEEDS.md` has the figures.
///
/// # Formula
/// `m <- 0.9 m + 0.1 g`, `s <- 0.999 s + 0.001 g^2`, `x <- x - rate m' / (sqrt(s') + 1e-15)` with the moments' bias taken out, and rates of
/// `1 / sqrt(1 + k / 40)` times the usual ones in a Gaussian's step k, from 0 on. A value without gradient so far stays where it is.
///
/// One with a warm start has `m <- 0.6 m + 0.4 g`, leaves m its bias, and has rates of `1.5 / sqrt(1 + k / 2)` times the usual ones in a Gaussian's step k: its steps
/// begin at half the rate, are longest in the fourth, and grow shorter. Usual first steps go by the sign of the gradient, a whole rate each,
/// which helps a scene that is far from its optimum and spoils one that is not: `measure/NEEDS.md` has the figures.
///
/// # Source
/// Kingma and Ba, Adam, 2015; Kerbl et al., 3D Gaussian splatting, 2023.
#[derive(Debug)]
pub struct Adam<'v> {
    settings: AdamSettings,
    /// What the steps that are not ahead on a GPU have left.
    memory: Memory,
    /// Steps so far, those ahead among them.
    steps: usize,
    /// Of a Gaussian's first step and those that follow, as many as one can have made.
    paces: Vec<Pace>,
    kept: Kept<'v>,
    /// The scene and its moments on a GPU, where steps are made there.
    #[cfg(feature = "gpu")]
    there: Option<gpu::There>,
    /// What the steps looked at that only the GPU has made.
    #[cfg(feature = "gpu")]
    ahead: Vec<Vec<&'v View>>,
    summary: AdamSummary,
}

/// What earlier steps have left of each Gaussian.
#[derive(Debug)]
struct Memory {
    /// `[N, 17, 2]` first and second moments.
    moments: Vec<[[f32; 2]; VARIABLES]>,
    /// `[N]` steps that moved it.
    counts: Vec<u32>,
}

impl<'v> Adam<'v> {
    /// An optimisation of `num_gaussians` that has not begun.
    pub fn new(num_gaussians: usize, settings: AdamSettings) -> Self {
        Self {
            settings,
            memory: Memory { moments: vec![[[0.0; 2]; VARIABLES]; num_gaussians], counts: vec![0; num_gaussians] },
            steps: 0,
            paces: Vec::new(),
            kept: Kept::default(),
            #[cfg(feature = "gpu")]
            there: None,
            #[cfg(feature = "gpu")]
            ahead: Vec::new(),
            summary: AdamSummary { pixel_stride: 1, ..AdamSummary::default() },
        }
    }

    /// Moves both branches, and the velocities of the `LiDAR` branch, by steps that look at each view once; the mean over the views of the loss
    /// before their step. Views may have other pixels in another pass, but there are as many of them.
    pub fn pass(&mut self, set: &mut GaussianSet, views: &[&'v View]) -> f64 {
        let loss = self.pass_ahead(set, views);
        self.settle(set);
        loss
    }

    /// As [`Adam::pass`], but that on a GPU the scene stays there: `set` is as it was, and nobody may change it, until [`Adam::settle`].
    pub fn pass_ahead(&mut self, set: &mut GaussianSet, views: &[&'v View]) -> f64 {
        let mut sum = 0.0;
        for _ in 0..self.settings.schedule.steps_of_turn(views.len()) {
            let chosen = self.settings.schedule.of_step(self.steps, views);
            sum += self.step_ahead(set, views, &chosen) * chosen.len() as f64;
            self.steps += 1;
        }
        let loss = sum / views.len().max(1) as f64;
        self.summary.losses.push(loss);
        loss
    }

    /// Brings the scene to where the steps have led.
    pub fn settle(&mut self, set: &mut GaussianSet) {
        #[cfg(feature = "gpu")]
        self.settle_there(set);
        // Without GPUs it is there already.
        let _ = set;
    }

    /// The loss over the `chosen` of the views before a step that looks at them.
    fn step_ahead(&mut self, set: &mut GaussianSet, views: &[&'v View], chosen: &[&'v View]) -> f64 {
        #[cfg(feature = "gpu")]
        if let Some(loss) = self.step_there(set, views, chosen) {
            return loss;
        }
        let _ = views;
        self.step_here(set, chosen)
    }

    /// Of every step that a Gaussian can be at in the next one.
    fn know_paces(&mut self) {
        let known = self.paces.len();
        self.paces.extend((known..=self.steps).map(|done| Pace::of_step(done, self.settings.warm_start)));
    }

    fn step_here(&mut self, set: &mut GaussianSet, chosen: &[&'v View]) -> f64 {
        let wanted = Wanted { gradient: true, device: self.settings.device, ..Wanted::default() };
        let mut found = objective_keeping(set, chosen, &LossWeights::default(), wanted, &mut self.kept);
        self.summary.seconds.add(found.seconds);
        self.summary.non_finite_gradients += zero_non_finite(&mut found.gradient);
        let rates = self.settings.rates.by_variable();
        self.know_paces();
        let paces = &self.paces;
        let values = set.attributes.par_iter_mut().zip(&mut set.velocities);
        let gradients = found.gradient.attributes.par_iter().zip(&found.gradient.velocities);
        let memory = self.memory.moments.par_iter_mut().zip(&mut self.memory.counts);
        let all = values.zip(gradients).zip(memory).with_min_len(GRAIN);
        all.for_each(|(((row, velocity), (by_row, by_velocity)), (moments, count))| {
            if by_row.iter().all(|&gradient| gradient == 0.0) {
                return;
            }
            let pace = &paces[*count as usize];
            *count += 1;
            let all = row.iter_mut().chain(velocity).zip(by_row.iter().chain(by_velocity));
            for ((value, &gradient), (moment, rate)) in all.zip(moments.iter_mut().zip(&rates)) {
                *value -= to_f32(rate * pace.step(moment, f64::from(gradient)));
            }
        });
        found.loss
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

/// Optimises the scene in place by steps that look at all of the views; `progress` is told the loss before each.
pub fn adam(
    set: &mut GaussianSet,
    views: &[&View],
    rates: &AdamRates,
    steps: usize,
    mut progress: impl FnMut(f64),
) -> AdamSummary {
    let mut adam = Adam::new(set.len(), AdamSettings { rates: *rates, ..AdamSettings::default() });
    (0..steps).for_each(|_| progress(adam.pass(set, views)));
    adam.into_summary()
}
