//! Runs of a configuration through the pipeline, as `lgs-infer` goes through it: once for what it is worth, often for what it costs.

use std::collections::BTreeMap;

use base64::{Engine, engine::general_purpose::STANDARD};
use lgs_engine::{
    allocator,
    evaluate::lpips::Lpips,
    gaussians::GaussianSet,
    network::{model::Model, source::LoadedModel},
    pipeline::{self, GaussianCounts, Inputs, Reconstruction, Silent, StageTimes, Watch, begin},
};
use serde::{Deserialize, Serialize};

use super::{
    case::{Case, SceneFigures, Work, scene_figures},
    grid::Run,
    setting::Setting,
};
use crate::{
    error::{MeasureError, Result},
    means::Means,
};

/// What configurations are run on.
#[derive(Clone, Copy, Debug)]
pub struct Bench<'a> {
    /// What a reconstruction reads.
    pub inputs: &'a Inputs,
    /// The networks.
    pub models: &'a [LoadedModel],
    /// Seed of everything that is drawn at random.
    pub seed: u64,
}

/// What a reconstruction took, from the loaded inputs on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cost {
    /// Seconds of all of it.
    pub seconds: f64,
    /// Seconds of each stage, under its name in `metrics.json`; `None` for what is not known.
    pub stages: BTreeMap<String, Option<f64>>,
}

/// How many Gaussians a configuration started with, changed and ended with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Counts {
    /// Returns that some input camera sees.
    pub returns: usize,
    /// `LiDAR` branch at the beginning.
    pub initial: usize,
    /// Taken from it.
    pub pruned: usize,
    /// Added to it.
    pub added: usize,
    /// `LiDAR` branch at the end.
    pub last: usize,
    /// Taken from the background branch.
    #[serde(default)]
    pub background_pruned: usize,
    /// Background branch at the end.
    pub background: usize,
}

impl From<GaussianCounts> for Counts {
    fn from(counts: GaussianCounts) -> Self {
        let GaussianCounts { returns, initial, pruned, added, last, background_pruned, background } = counts;
        Self { returns, initial, pruned, added, last, background_pruned, background }
    }
}

/// What a configuration is worth: the same in every run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Accuracy {
    /// Mean figures over the held-out views.
    pub figures: Means,
    /// How many Gaussians there were.
    pub gaussians: Counts,
    /// Steps of the learned refinement that were kept; `None` without a network.
    pub steps_kept: Option<usize>,
}

/// A scene, and how it came about.
#[derive(Clone, Debug)]
pub struct Made {
    /// The scene.
    pub scene: GaussianSet,
    /// How many Gaussians there were.
    pub counts: GaussianCounts,
    /// Steps of the learned refinement that were kept; `None` without a network.
    pub steps_kept: Option<usize>,
    /// Largest resident memory of this process when it was made, 10^6 bytes.
    pub peak_rss_mb: Option<f64>,
}

impl Bench<'_> {
    /// What each configuration of a run costs.
    ///
    /// # Errors
    /// Those of the pipeline.
    pub fn costs(&self, run: &Run) -> Result<Vec<Cost>> {
        let mut taken = Vec::with_capacity(run.settings.len());
        self.pass(run, &mut |made, times| taken.push((made.seconds, *times)))?;
        let cost = |(seconds, times)| Ok(Cost { seconds, stages: by_name(&times)? });
        taken.into_iter().map(cost).collect()
    }

    /// The scene of each configuration of a run.
    ///
    /// # Errors
    /// Those of the pipeline.
    pub fn scenes(&self, run: &Run) -> Result<Vec<Made>> {
        let mut all = Vec::with_capacity(run.settings.len());
        self.pass(run, &mut |made, _| {
            all.push(Made {
                scene: made.scene.clone(),
                counts: made.counts,
                steps_kept: made.network.as_ref().map(|network| network.refine.steps),
                peak_rss_mb: allocator::peak_rss_mb(),
            });
        })?;
        Ok(all)
    }

    /// Brings caches and pools to where a run leaves them, with at most one pass of per-scene optimisation.
    ///
    /// # Errors
    /// Those of the pipeline.
    pub fn warm_up(&self, run: &Run) -> Result<()> {
        let mut short = run.clone();
        short.settings.truncate(1);
        for setting in &mut short.settings {
            setting.recipe.adam_passes = setting.recipe.adam_passes.min(1);
        }
        self.pass(&short, &mut |_, _| ())
    }

    /// One way through the pipeline; `show` is given each configuration of the run when it is reached.
    fn pass(&self, run: &Run, show: &mut dyn FnMut(&Reconstruction, &StageTimes)) -> Result<()> {
        let Some(last) = run.settings.last() else { return Ok(()) };
        let (model, seed) = (self.model(run, last)?, self.seed);
        let marks: Vec<usize> = run.settings.iter().map(|setting| setting.recipe.adam_passes).collect();
        let mut watch = Watch::new(&Silent);
        let whole = pipeline::Run { recipe: last.recipe, model, seed, deadline: None };
        begin(self.inputs, &mut watch)?.run(&whole, &mut watch, &marks, show)?;
        Ok(())
    }

    fn model(&self, run: &Run, setting: &Setting) -> Result<Option<&Model>> {
        let (Some(index), Some(weights)) = (run.network, &setting.weights) else { return Ok(None) };
        let loaded = self.models.get(index).filter(|loaded| loaded.digest == weights.sha256);
        let others = || MeasureError::unfit("weights", format!("those of {}", setting.name()), "others");
        Ok(Some(&loaded.ok_or_else(others)?.model))
    }
}

fn by_name(times: &StageTimes) -> Result<BTreeMap<String, Option<f64>>> {
    let read = || serde_json::from_value(serde_json::to_value(times)?);
    read().map_err(|source| MeasureError::Json { what: "times of stages", source })
}

/// What a run is worth, found out in a process of its own, so that its memory is that of the run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunEvaluation {
    /// How much there is to do on the clip.
    pub work: Work,
    /// Of each configuration of the run.
    pub points: Vec<PointEvaluation>,
}

/// What a configuration is worth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointEvaluation {
    /// The figures.
    pub accuracy: Accuracy,
    /// Largest resident memory of this process when the scene was made, 10^6 bytes.
    pub peak_rss_mb: Option<f64>,
    /// A part of a held-out view as it was drawn: a JPEG file in base64.
    pub crop: Option<String>,
}

/// What the configurations of a run are worth on a clip.
///
/// # Errors
/// Whatever is wrong with the clip; those of the pipeline; a scene that draws a value that is not finite.
pub fn evaluate(
    case: &Case,
    run: &Run,
    models: &[LoadedModel],
    seed: u64,
    lpips: Option<&Lpips>,
) -> Result<RunEvaluation> {
    let (session, _) = case.open()?;
    let made = Bench { inputs: session.inputs(), models, seed }.scenes(run)?;
    let work = Work::of(&session)?;
    let scenes: Vec<&GaussianSet> = made.iter().map(|made| &made.scene).collect();
    let scene_figures = scene_figures(&session, &scenes, lpips)?;
    let point = |(made, scored): (&Made, SceneFigures)| {
        let accuracy = Accuracy { figures: scored.figures, gaussians: made.counts.into(), steps_kept: made.steps_kept };
        let crop = scored.crop.map(|crop| crop.jpeg()).transpose()?.map(|bytes| STANDARD.encode(bytes));
        Ok(PointEvaluation { accuracy, peak_rss_mb: made.peak_rss_mb, crop })
    };
    Ok(RunEvaluation { work, points: made.iter().zip(scene_figures).map(point).collect::<Result<_>>()? })
}
