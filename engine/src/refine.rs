//! The learned refinement: render, loss, gradient, network, update, a few times over.

pub mod adam;
mod lengths;
mod pixel_stride;
mod summary;
mod view_schedule;

use std::{borrow::Cow, time::Instant};

use candle_core::Tensor;
use rayon::prelude::*;

use crate::error::Result;
use crate::gaussians::{Branch, GaussianSet, RawGradient};
use crate::loss::{Kept, LossWeights};
use crate::network::config::{Guidance, ModelConfig, StepLength};
use crate::network::guide::{Guide, gradient_inputs, refine_inputs, refine_rows};
use crate::network::levels::Levels;
use crate::network::model::Model;
use crate::objective::{Objective, Wanted, objective_keeping};
use crate::ops::tensors::of_rows;
use crate::predict::add_outputs;
use crate::render::{MemoryEstimate, Pass};
use crate::views::{View, strided};

use lengths::{Before, step_lengths_with};
pub use lengths::{lengthen, step_lengths};
pub use pixel_stride::PixelStride;
pub use summary::{LastStep, LineSearch, RefineSeconds, RefineSettings, RefineSummary};
pub use view_schedule::ViewSchedule;

/// Voxel pyramids of both branches, kept while no primitive leaves its voxel.
#[derive(Debug, Default)]
struct Pyramid {
    kept: Option<(Vec<[i32; 4]>, Levels)>,
    reused: usize,
}

impl Pyramid {
    fn over(&mut self, set: &GaussianSet, chosen: &[usize], model: &Model, branch: Branch) -> Result<&Levels> {
        let voxels = model.voxels(set, chosen, branch)?;
        let kept = match self.kept.take() {
            Some((old, levels)) if old == voxels => {
                self.reused += 1;
                (old, levels)
            }
            _ => {
                let levels = model.levels(&voxels, branch)?;
                (voxels, levels)
            }
        };
        Ok(&self.kept.insert(kept).1)
    }
}

/// Refines the scene in place over the input views.
///
/// # Formula
/// `g <- g + l r(g, t, v, grad g, grad v)`, `steps` times with the same weights, both branches; l is 1, or for each Gaussian that of
/// [`step_lengths`] where the settings ask for it in that step. Where every step looks at all views, a step
/// after which their loss has not fallen is taken back and ends the loop; the last step is measured too, so that no result is worse than
/// its start, unless it is to be kept anyhow. Steps that look at some of the views are not measured. A step that changes nothing ends the loop.
///
/// # Gradient
/// The loss gradients are inputs of the network and constants.
///
/// # Errors
/// When a value of the scene is not finite, a position leaves the voxel grid, or a view cannot be drawn in the memory that is free.
pub fn refine(
    set: &mut GaussianSet,
    views: &[&View],
    model: &Model,
    settings: impl Into<RefineSettings>,
    mut progress: impl FnMut(),
) -> Result<RefineSummary> {
    refine_showing(set, views, model, settings, |_| progress())
}

/// As [`refine`]; `show` is given the scene after every step that was kept.
///
/// # Errors
/// As [`refine`].
pub fn refine_showing(
    set: &mut GaussianSet,
    views: &[&View],
    model: &Model,
    settings: impl Into<RefineSettings>,
    mut show: impl FnMut(&GaussianSet),
) -> Result<RefineSummary> {
    let settings: RefineSettings = settings.into();
    if settings.steps == 0 || views.is_empty() || set.is_empty() {
        return Ok(RefineSummary::default());
    }
    set.check_finite()?;
    let stride = settings.pixel_stride.of(views);
    let drawn = strided(views, stride, 0);
    let views: Vec<&View> = drawn.iter().map(Cow::as_ref).collect();
    let mut refinement = Refinement::new(model, settings, stride);
    // Steps that look at all views are measured: only one that lowers the loss is accepted.
    let is_measured = settings.schedule.take_all(views.len());
    let mut carried = None;
    for index in 0..settings.steps {
        let looked = Instant::now();
        let chosen = settings.schedule.of_step(index, &views);
        let mut current = match carried.take() {
            Some(measured) => measured,
            None => refinement.measure(set, &chosen, index)?,
        };
        // What the next step will take again: of steps that are measured, only the first begins with a measurement of its own.
        let begun = if is_measured { Instant::now() } else { looked };
        let before = set.clone();
        let has_moved = refinement.step(set, &before, &mut current, &chosen, index)?;
        let is_taken = settings.last == LastStep::Kept && index + 1 == settings.steps;
        let measures = has_moved && is_measured && !is_taken;
        let after = if measures { Some(refinement.measure(set, &chosen, index + 1)?) } else { None };
        if !has_moved || !refinement.accept(set, before, current.loss, after.as_ref()) {
            refinement.summary.stopped_early = true;
            break;
        }
        carried = after;
        show(set);
        if settings.until.is_some_and(|until| Instant::now() + begun.elapsed() > until) {
            break;
        }
    }
    Ok(refinement.finish())
}

/// A refinement between two of its steps.
struct Refinement<'a, 'v> {
    model: &'a Model,
    settings: RefineSettings,
    /// Of the `LiDAR` branch and of the background.
    pyramids: [Pyramid; 2],
    kept: Kept<'v>,
    summary: RefineSummary,
}

impl<'a, 'v> Refinement<'a, 'v> {
    fn new(model: &'a Model, settings: RefineSettings, pixel_stride: usize) -> Self {
        Self {
            model,
            settings,
            pyramids: Default::default(),
            kept: Kept::with_drawn(),
            summary: RefineSummary { pixel_stride: Some(pixel_stride), ..RefineSummary::default() },
        }
    }

    /// Whether every Gaussian's length of a step is searched for.
    fn searches(&self, index: usize) -> bool {
        let RefineSettings { steps, line_search, .. } = self.settings;
        line_search.takes(self.model.config.step_length, index + 1 == steps)
    }

    /// The loss of the scene before step `index`, with what the step takes; of the refined scene, which is before none, alone.
    ///
    /// # Errors
    /// As [`MemoryEstimate::check`].
    fn measure(&mut self, set: &GaussianSet, views: &[&'v View], index: usize) -> Result<Objective> {
        let wanted = if index < self.settings.steps {
            Wanted { images: self.searches(index), ..wanted(&self.model.config) }
        } else {
            Wanted::default()
        };
        let wanted = Wanted { device: self.settings.device, ..wanted };
        MemoryEstimate::of_set(set).check(views.iter().map(|view| &view.pinhole), Pass::Gradient)?;
        let found = objective_keeping(set, views, &LossWeights::default(), wanted, &mut self.kept);
        self.summary.losses.push(found.loss);
        self.summary.seconds.add(found.seconds);
        Ok(found)
    }

    /// Moves both branches, which are as `before`, by what the network says of a measurement, as far as each Gaussian's length; whether anything has moved.
    fn step(
        &mut self,
        set: &mut GaussianSet,
        before: &GaussianSet,
        current: &mut Objective,
        views: &[&'v View],
        index: usize,
    ) -> Result<bool> {
        self.summary.non_finite_gradients += zero_non_finite_guide(current, self.model.config.guidance);
        self.summary.unseen = current.seen.iter().filter(|seen| !**seen).count();
        let start = Instant::now();
        for (branch, pyramid) in Branch::ALL.into_iter().zip(&mut self.pyramids) {
            self.summary.non_finite_outputs += step(set, current, self.model, branch, pyramid)?;
        }
        self.summary.seconds.network += start.elapsed().as_secs_f64();
        if set == before {
            return Ok(false);
        }
        if self.searches(index) {
            let start = Instant::now();
            let drawn = Before { images: &current.images, scene: before };
            let lengths = step_lengths_with(self.settings.device, drawn, set, views, &mut self.kept);
            lengthen(set, before, &lengths);
            self.summary.seconds.lengths += start.elapsed().as_secs_f64();
        }
        Ok(true)
    }

    /// Whether a step is kept: where it was measured, the loss has to have fallen; else the scene is what it was before.
    fn accept(&mut self, set: &mut GaussianSet, before: GaussianSet, loss: f64, after: Option<&Objective>) -> bool {
        // Written so that a loss that is not a number counts as no gain.
        let is_kept = after.is_none_or(|after| after.loss < loss);
        if is_kept {
            self.summary.steps += 1;
        } else {
            *set = before;
        }
        is_kept
    }

    fn finish(mut self) -> RefineSummary {
        self.summary.pyramids_kept = self.pyramids[0].reused;
        self.summary
    }
}

/// What a model asks of the objective beside the loss.
pub fn wanted(config: &ModelConfig) -> Wanted {
    Wanted {
        gradient: config.guidance == Guidance::Gradient,
        mean_residuals: config.guidance == Guidance::Residual,
        images: config.step_length == StepLength::Local,
        ..Wanted::default()
    }
}

/// What guides a model.
pub const fn guide(objective: &Objective, guidance: Guidance) -> Guide<'_> {
    match guidance {
        Guidance::Gradient => Guide::Gradient(&objective.gradient),
        Guidance::Residual => Guide::Residual(&objective.mean_residuals),
    }
}

/// Sets what guides a model to zero for every Gaussian of which a value is not finite, and counts them.
pub fn zero_non_finite_guide(objective: &mut Objective, guidance: Guidance) -> usize {
    zero_non_finite(match guidance {
        Guidance::Gradient => &mut objective.gradient,
        Guidance::Residual => &mut objective.mean_residuals.gradient,
    })
}

/// One step of one branch; how many Gaussians were left as they were because their outputs are not finite.
fn step(
    set: &mut GaussianSet,
    objective: &Objective,
    model: &Model,
    branch: Branch,
    pyramid: &mut Pyramid,
) -> Result<usize> {
    let seen: Vec<usize> = set.rows(branch).filter(|&i| objective.seen[i]).collect();
    if seen.is_empty() {
        return Ok(0);
    }
    let levels = pyramid.over(set, &seen, model, branch)?;
    let [_, outputs] = StepInputs { set, objective, seen: &seen, levels }.outputs(model, branch, false)?;
    let left_out = add_outputs(set, &seen, &outputs)?;
    Ok(left_out.not_finite.len() + left_out.carried_away.len())
}

/// What a step of one branch starts from.
#[derive(Clone, Copy, Debug)]
pub struct StepInputs<'a> {
    /// The scene.
    pub set: &'a GaussianSet,
    /// What the rendered views say of it.
    pub objective: &'a Objective,
    /// The Gaussians of the branch that are seen.
    pub seen: &'a [usize],
    /// The pyramid over their voxels.
    pub levels: &'a Levels,
}

impl StepInputs<'_> {
    /// Features and head outputs of the step.
    ///
    /// # Shapes
    /// Result `[n, width]` and `[n, outputs]`.
    ///
    /// # Gradient
    /// By all parameters of the pass; the scene and what guides the step are constants. With `train` normalisation is by batch statistics.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn outputs(&self, model: &Model, branch: Branch, train: bool) -> Result<[Tensor; 2]> {
        let (guidance, pass) = (model.config.guidance, model.refine_of(branch));
        let rows = refine_rows(self.set, guide(self.objective, guidance), self.seen, branch.moves());
        let inputs = of_rows(rows.inputs, refine_inputs(guidance, branch.moves()))?;
        let point_inputs = of_rows(rows.point_inputs, gradient_inputs(branch.moves()))?;
        let features = pass.gated_features(&inputs, &point_inputs, self.levels, train)?;
        let outputs = pass.heads().forward(&features, &inputs)?;
        Ok([features, outputs])
    }
}

/// Sets the gradient of every Gaussian that has a value that is not finite to zero, and counts them.
pub fn zero_non_finite(gradient: &mut RawGradient) -> usize {
    let rows = gradient.attributes.par_iter_mut().zip(&mut gradient.velocities).with_min_len(4096);
    let spoiled = rows.filter(|(a, v)| !a.iter().chain(v.iter()).all(|x| x.is_finite()));
    spoiled.map(|(a, v)| (a.fill(0.0), v.fill(0.0))).count()
}
