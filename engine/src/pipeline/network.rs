//! The network's stages between the initial Gaussians and the finished scene.

use serde::Serialize;

use super::{Stage, Watch};
use crate::error::Result;
use crate::gaussians::GaussianSet;
use crate::network::model::FoldedModel;
use crate::predict::{QuerySkipped, backbone, predict, query};
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
}

/// What the network's stages did, and what they left out because the scene did not need it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct NetworkSummary {
    /// Why the query did not run; `None` when it ran.
    pub query_skipped: Option<QuerySkipped>,
    /// The refinement.
    pub refine: RefineSummary,
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
    drop(features);
    let refine = watch.stage(Stage::Refine, settings.refine_steps, |progress| {
        refine(scene, views, model, settings.refine_steps, || progress.step(Stage::Refine))
    })?;
    Ok(NetworkSummary { query_skipped, refine })
}
