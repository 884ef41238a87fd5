//! The network's stages between the initial Gaussians and the finished scene.

use serde::Serialize;

use super::{Stage, Watch};
use crate::densify::{self, Density, Scores, Thresholds, UpdateCounts};
use crate::error::Result;
use crate::gaussians::GaussianSet;
use crate::network::model::FoldedModel;
use crate::predict::{Features, QuerySkipped, backbone, predict, query, scores};
use crate::refine::{RefineSummary, refine};
use crate::views::View;

/// How the network is used.
#[derive(Clone, Copy, Debug)]
pub struct NetworkSettings<'a> {
    /// The network.
    pub model: &'a FoldedModel,
    /// Steps of the learned refinement.
    pub refine_steps: usize,
    /// Whether primitives ask those of other timestamps.
    pub query: bool,
    /// Who decides on the set update.
    pub density: Density,
    /// Scores above which a primitive is pruned or copied.
    pub thresholds: Thresholds,
    /// Largest number of primitives of the `LiDAR` branch after the set update.
    pub max_gaussians: Option<usize>,
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
    /// What the set update did.
    #[serde(skip)]
    pub update: UpdateCounts,
    /// The refinement.
    pub refine: RefineSummary,
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
/// When a position is not finite or leaves the voxel grid.
pub fn run_network(
    scene: &mut GaussianSet,
    views: &[&View],
    settings: &NetworkSettings<'_>,
    watch: &mut Watch<'_>,
) -> Result<NetworkSummary> {
    let model = settings.model;
    let mut features = watch.stage(Stage::Backbone, 1, |_| backbone(scene, model))?;
    let query_skipped = if settings.query {
        watch.stage(Stage::Query, 1, |_| query(&mut features, scene, model))?
    } else {
        Some(QuerySkipped::Off)
    };
    watch.time(Stage::Backbone, |_| predict(scene, &mut features, model))?;
    let (update, set_update_skipped) = update_set(scene, &mut features, settings, watch)?;
    drop(features);
    let refine = watch.stage(Stage::Refine, settings.refine_steps, |progress| {
        refine(scene, views, model, settings.refine_steps, || progress.step(Stage::Refine))
    })?;
    Ok(NetworkSummary { query_skipped, set_update_skipped, update, refine })
}

/// Scores the primitives and prunes and adds by the scores.
fn update_set(
    scene: &mut GaussianSet,
    features: &mut Features,
    settings: &NetworkSettings<'_>,
    watch: &mut Watch<'_>,
) -> Result<(UpdateCounts, Option<UpdateSkipped>)> {
    if settings.density == Density::Off {
        return Ok((UpdateCounts::default(), Some(UpdateSkipped::Off)));
    }
    let Some([prune, add]) = watch.stage(Stage::Policy, 1, |_| scores(features, scene, settings.model))? else {
        return Ok((UpdateCounts::default(), Some(UpdateSkipped::NotInModel)));
    };
    let scores = Scores { prune, add };
    let actions = watch.stage(Stage::SetUpdate, 1, |_| {
        let mut actions = match settings.max_gaussians {
            Some(budget) => densify::by_budget(&scores, settings.thresholds, budget)?,
            None => densify::by_thresholds(&scores, settings.thresholds)?,
        };
        if settings.density == Density::Random {
            actions = densify::at_random(&actions, settings.seed);
        }
        *scene = densify::apply(scene, &actions, settings.seed)?;
        Result::Ok(actions)
    })?;
    Ok((densify::count(&actions), None))
}
