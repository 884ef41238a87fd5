//! The network's stages between the initial Gaussians and the finished scene.

use std::time::Instant;

use serde::Serialize;

use super::{Pruning, Stage, Watch};
use crate::densify::{self, Density, DensityMap, Limit, Scope, Scores, Thresholds, UpdateCounts};
use crate::error::{EngineError, Result};
use crate::evidence::keep;
use crate::gaussians::GaussianSet;
use crate::network::model::Model;
use crate::predict::{QuerySkipped, backbone, predict, query, scores};
use crate::recipe::Recipe;
use crate::refine::{LastStep, RefineSettings, RefineSummary, refine};
use crate::render::{MemoryEstimate, Pass};
use crate::views::View;

/// How the network is used.
#[derive(Clone, Copy, Debug)]
pub struct NetworkSettings<'a> {
    /// The network.
    pub model: &'a Model,
    /// The learned refinement.
    pub refine: RefineSettings,
    /// Whether primitives ask those of other timestamps.
    pub query: bool,
    /// Who decides on the set update.
    pub density: Density,
    /// Scores above which a primitive is pruned or copied.
    pub thresholds: Thresholds,
    /// Which Gaussians exact pruning may take.
    pub density_scope: Scope,
    /// Largest number of those that it may take after the set update.
    pub max_gaussians: Option<Limit>,
    /// Seed of the set update.
    pub seed: u64,
}

/// What the network's stages did, and what they left out because the scene did not need it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct NetworkSummary {
    /// Why the query did not run; `None` when it ran.
    pub query_skipped: Option<QuerySkipped>,
    /// Why there was no set update; `None` when there was one.
    pub set_update_skipped: Option<UpdateSkipped>,
    /// The refinement.
    pub refine: RefineSummary,
}

/// What came of the network's stages beside the scene.
#[derive(Clone, Debug)]
pub struct NetworkRun {
    /// What they did.
    pub summary: NetworkSummary,
    /// What the set update did.
    pub update: UpdateCounts,
    /// The policy's scores; `None` where there was no set update.
    pub density: Option<DensityMap>,
}

/// Why there was no set update.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum UpdateSkipped {
    /// The setting says so.
    Off,
    /// The model has no policy.
    NotInModel,
}

/// Runs the network's stages on the scene, in place.
///
/// # Errors
/// When a position is not finite or leaves the voxel grid, or a budget was asked for and nobody scores the primitives.
pub fn run_network(
    scene: &mut GaussianSet,
    views: &[&View],
    settings: &NetworkSettings<'_>,
    watch: &mut Watch<'_>,
) -> Result<NetworkRun> {
    let model = settings.model;
    let set_update_skipped = match (settings.density, &model.policy) {
        (Density::Off, _) => Some(UpdateSkipped::Off),
        (Density::Exact, _) | (_, Some(_)) => None,
        (_, None) => Some(UpdateSkipped::NotInModel),
    };
    settings.check_budget(set_update_skipped)?;
    let mut features = watch.stage(Stage::Backbone, 1, |_| backbone(scene, model))?;
    let query_skipped = if settings.query {
        watch.stage(Stage::Query, 1, |_| query(&mut features, scene, model))?
    } else {
        Some(QuerySkipped::Off)
    };
    watch.time(Stage::Backbone, |_| predict(scene, &features, model))?;
    let (mut update, mut density) = (UpdateCounts::default(), None);
    if settings.density == Density::Exact {
        MemoryEstimate::of_set(scene).check(views.iter().map(|view| &view.pinhole), Pass::Gradient)?;
        let (scope, limit, refine) = (settings.density_scope, settings.max_gaussians, settings.refine);
        let pruning = Pruning { scope, limit, refine };
        let rows = watch.stage(Stage::SetUpdate, pruning.parts(scene), |progress| {
            pruning.prune(scene, views, model, &mut || progress.step(Stage::SetUpdate))
        })?;
        update = keep(scene, &rows);
    } else if set_update_skipped.is_none()
        && let Some([prune, add]) = watch.stage(Stage::Policy, 1, |_| scores(&features, scene, model))?
    {
        let scores = Scores { prune, add };
        (update, density) = watch.stage(Stage::SetUpdate, 1, |_| update_set(scene, scores, settings))?;
    }
    drop(features);
    let refine = watch.stage(Stage::Refine, settings.refine.steps, |progress| {
        refine(scene, views, model, settings.refine, || progress.step(Stage::Refine))
    })?;
    watch.times.add_refine(refine.seconds);
    Ok(NetworkRun { summary: NetworkSummary { query_skipped, set_update_skipped, refine }, update, density })
}

impl<'a> NetworkSettings<'a> {
    /// As a recipe says. No learned step begins that would probably end after `until`.
    pub fn of(recipe: &Recipe, model: &'a Model, seed: u64, until: Option<Instant>) -> Self {
        Self {
            model,
            refine: RefineSettings {
                steps: recipe.refine_steps,
                schedule: recipe.view_schedule(seed),
                pixel_stride: recipe.pixel_stride,
                until,
                line_search: recipe.line_search,
                last: if recipe.adam_passes > 0 { LastStep::Kept } else { LastStep::Checked },
                device: recipe.device(),
            },
            query: recipe.query,
            density: recipe.density,
            density_scope: recipe.density_scope,
            thresholds: recipe.thresholds,
            max_gaussians: recipe.max_gaussians,
            seed,
        }
    }

    /// # Errors
    /// When there is a budget and no set update that could meet it.
    fn check_budget(&self, skipped: Option<UpdateSkipped>) -> Result<()> {
        let found = match skipped {
            Some(UpdateSkipped::Off) => "`density off`",
            Some(UpdateSkipped::NotInModel) => "weights of a model without one",
            None => return Ok(()),
        };
        if self.max_gaussians.is_none() {
            return Ok(());
        }
        let (expected, found) =
            ("a policy that scores the primitives, or `density exact`".to_owned(), found.to_owned());
        Err(EngineError::Setting { setting: "max-gaussians", expected, found })
    }
}

/// Prunes and adds by the scores; what was done, and the scores to look at.
fn update_set(
    scene: &mut GaussianSet,
    scores: Scores,
    settings: &NetworkSettings<'_>,
) -> Result<(UpdateCounts, Option<DensityMap>)> {
    let mut actions = densify::decide(&scores, settings.thresholds, settings.max_gaussians)?;
    if settings.density == Density::Random {
        actions = densify::at_random(&actions, settings.seed);
    }
    let updated = densify::apply(scene, &actions, settings.seed)?;
    let scored = std::mem::replace(scene, updated);
    let updated = scores.at(&densify::origins(&actions));
    Ok((densify::count(&actions), Some(DensityMap { scored, scores, updated })))
}
