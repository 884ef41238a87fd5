//! The learned refinement: render, loss, gradient, network, update, a few times over.

pub mod adam;
mod lengths;
mod summary;
mod turns;

use std::{borrow::Cow, time::Instant};

use crate::error::Result;
use crate::gaussians::{GaussianSet, MEAN, RawGradient};
use crate::loss::LossWeights;
use crate::network::buffers::Buffers;
use crate::network::config::{Guidance, ModelConfig, StepLength};
use crate::network::guide::{Guide, refine_inputs, refine_rows};
use crate::network::levels::{Levels, voxels_of};
use crate::network::model::FoldedModel;
use crate::network::normalise::add_residuals;
use crate::network::pass::{FoldedPass, gather, with_own};
use crate::objective::{Objective, Wanted, objective_with};
use crate::render::{MemoryEstimate, Pass};
use crate::views::{View, at_factor};

pub use lengths::{lengthen, step_lengths};
pub use summary::{LineSearch, Measured, RefineSeconds, RefineSettings, RefineSummary, Refined};
pub use turns::Turns;

/// Voxel pyramids of both branches, kept while no primitive leaves its voxel.
#[derive(Debug, Default)]
struct Pyramid {
    kept: Option<(Vec<[i32; 4]>, Levels)>,
    reused: usize,
}

impl Pyramid {
    fn of(&mut self, set: &GaussianSet, range: &[usize], voxel_size: f64, num_levels: usize) -> Result<&Levels> {
        let positions = range.iter().map(|&i| [0, 1, 2].map(|k| set.attributes[i][MEAN.start + k]));
        let voxels = voxels_of(positions, voxel_size)?;
        let kept = match self.kept.take() {
            Some((old, levels)) if old == voxels => {
                self.reused += 1;
                (old, levels)
            }
            _ => {
                let levels = Levels::new(&voxels, num_levels)?;
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
/// [`step_lengths`] where the model's config asks for it and the settings do for that step. Where every step looks at all views, a step
/// after which their loss has not fallen is taken back and ends the loop; the last step is measured too, so that no result is worse than
/// its start. Steps that look at some of the views are not measured. A step that changes nothing ends the loop.
///
/// # Gradient
/// The loss gradients are inputs of the network and constants.
///
/// # Errors
/// When a value of the scene is not finite, a position leaves the voxel grid, or a view cannot be drawn in the memory that is free.
pub fn refine(
    set: &mut GaussianSet,
    views: &[&View],
    model: &FoldedModel,
    settings: impl Into<RefineSettings>,
    mut progress: impl FnMut(),
) -> Result<RefineSummary> {
    Ok(refine_and_measure(set, views, model, settings, |_| progress())?.summary)
}

/// As [`refine`], with what was measured last; `show` is given the scene after every step that was kept.
///
/// # Errors
/// As [`refine`].
pub fn refine_and_measure(
    set: &mut GaussianSet,
    views: &[&View],
    model: &FoldedModel,
    settings: impl Into<RefineSettings>,
    mut show: impl FnMut(&GaussianSet),
) -> Result<Refined> {
    let RefineSettings { steps, turns, reduce, until, line_search, optimised_after } = settings.into();
    let mut summary = RefineSummary::default();
    let (mut pyramids, mut buffers) = ([Pyramid::default(), Pyramid::default()], Buffers::default());
    if steps == 0 || views.is_empty() || set.is_empty() {
        return Ok(Refined::default());
    }
    set.check_finite()?;
    let reduced = at_factor(views, reduce);
    let views: Vec<&View> = reduced.iter().map(Cow::as_ref).collect();
    let guidance = model.config.guidance;
    let searches = |index| model.config.step_length == StepLength::Local && line_search.takes(index + 1 == steps);
    // What is wanted of the scene before a step, and of the refined one, which is before none.
    let wanted_before = |index| match index < steps {
        true => Wanted { images: searches(index), ..wanted(&model.config) },
        false => Wanted { gradient: optimised_after, ..Wanted::default() },
    };
    let judged = turns.take_all(views.len());
    let mut carried = None;
    for index in 0..steps {
        let looked = Instant::now();
        let chosen = turns.of_step(index, &views);
        let mut current = match carried.take() {
            Some(measured) => measured,
            None => measured(set, &chosen, wanted_before(index), &mut summary)?,
        };
        // What the next step will take again: of steps that are judged, only the first begins with a measurement of its own.
        let begun = if judged { Instant::now() } else { looked };
        let before = set.clone();
        summary.non_finite_gradients += silence_guide(&mut current, guidance);
        summary.unseen = current.seen.iter().filter(|seen| !**seen).count();
        let start = Instant::now();
        for (branch, pyramid) in pyramids.iter_mut().enumerate() {
            summary.non_finite_outputs += step(set, &current, model, (branch == 0, pyramid), &mut buffers)?;
        }
        summary.seconds.network += start.elapsed().as_secs_f64();
        if *set == before {
            summary.stopped_early = true;
            break;
        }
        if searches(index) {
            let start = Instant::now();
            lengthen(set, &before, &step_lengths(&current.images, set, &chosen));
            summary.seconds.lengths += start.elapsed().as_secs_f64();
        }
        if judged {
            let after = measured(set, &chosen, wanted_before(index + 1), &mut summary)?;
            // Written so that a loss that is not a number counts as no gain.
            let fell = after.loss < current.loss;
            if !fell {
                *set = before;
                summary.stopped_early = true;
                break;
            }
            carried = Some(after);
        }
        summary.steps += 1;
        show(set);
        if until.is_some_and(|until| Instant::now() + begun.elapsed() > until) {
            break;
        }
    }
    summary.pyramids_kept = pyramids[0].reused;
    let has_gradient = optimised_after && summary.steps == steps;
    let measured = carried.filter(|_| has_gradient).map(|objective| Measured { objective, reduce });
    Ok(Refined { summary, measured })
}

/// The objective, noted in the summary.
///
/// # Errors
/// As [`MemoryEstimate::check`].
fn measured(set: &GaussianSet, views: &[&View], wanted: Wanted, summary: &mut RefineSummary) -> Result<Objective> {
    MemoryEstimate::of_set(set).check(views.iter().map(|view| &view.pinhole), Pass::Gradient)?;
    let found = objective_with(set, views, &LossWeights::default(), wanted);
    summary.losses.push(found.loss);
    summary.seconds.render += found.seconds.render;
    summary.seconds.loss += found.seconds.loss;
    Ok(found)
}

/// What a model asks of the objective beside the loss.
pub fn wanted(config: &ModelConfig) -> Wanted {
    Wanted {
        gradient: config.guidance == Guidance::Gradient,
        mean_residuals: config.guidance == Guidance::Residual,
        images: config.step_length == StepLength::Local,
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
pub fn silence_guide(objective: &mut Objective, guidance: Guidance) -> usize {
    silence(match guidance {
        Guidance::Gradient => &mut objective.gradient,
        Guidance::Residual => &mut objective.mean_residuals.gradient,
    })
}

/// One step of one branch; how many Gaussians were left as they were because their outputs are not finite.
fn step(
    set: &mut GaussianSet,
    objective: &Objective,
    model: &FoldedModel,
    (moving, pyramid): (bool, &mut Pyramid),
    buffers: &mut Buffers,
) -> Result<usize> {
    let range = if moving { 0..set.num_lidar } else { set.num_lidar..set.len() };
    let seen: Vec<usize> = range.filter(|&i| objective.seen[i]).collect();
    if seen.is_empty() {
        return Ok(0);
    }
    let config = &model.config;
    let (pass, cin, voxel_size, unet): (&FoldedPass, _, _, _) = if moving {
        (&model.refine, refine_inputs(config.guidance, true), config.voxel_size, &config.unet)
    } else {
        let inputs = refine_inputs(config.guidance, false);
        (&model.background_refine, inputs, config.background_voxel_size, &config.background_unet)
    };
    let levels = pyramid.of(set, &seen, voxel_size, unet.num_levels())?;
    let rows = refine_rows(set, guide(objective, config.guidance), &seen, moving);
    let by_site = pass.site_features(&rows.inputs, cin, levels, buffers);
    let mut features = gather(&by_site, levels, buffers);
    let heads = pass.heads();
    if !heads.read_own() {
        with_own(&mut features, &rows.own, seen.len());
    }
    let outputs = heads.forward(&features, &rows.inputs, seen.len(), buffers);
    let left_out = add_residuals(set, &seen, &outputs, heads.num_outputs());
    [by_site, features, outputs].into_iter().for_each(|buffer| buffers.give(buffer));
    Ok(left_out.not_finite.len() + left_out.carried_away.len())
}

/// Sets the gradient of every Gaussian that has a value that is not finite to zero, and counts them.
pub fn silence(gradient: &mut RawGradient) -> usize {
    let rows = gradient.attributes.iter_mut().zip(&mut gradient.velocities);
    let spoiled = rows.filter(|(a, v)| !a.iter().chain(v.iter()).all(|x| x.is_finite()));
    spoiled.map(|(a, v)| (a.fill(0.0), v.fill(0.0))).count()
}
