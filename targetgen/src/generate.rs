//! One clip: scene to targets.

use std::time::Instant;

use lgs_engine::loss::LossWeights;
use lgs_formats::targets::{ClipTargets, Signal, TargetsConfig};

use crate::branches::{Problem, Round, branch_gradients};
use crate::delta::{
    ActionDeltas, Deltas, NeighbourSets, footprint_deltas, magnitude_deltas, merge_rounds, response_deltas,
};
use crate::error::Result;
use crate::exact::{exact, of_rounds};
use crate::footprint::footprints;
use crate::scene::PredictedScene;
use crate::target::{Targets, stored, targets};

/// Seconds of the stages of a clip.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Seconds {
    /// Clip to scene.
    pub scene: f64,
    /// Sampling, copies, neighbours.
    pub sample: f64,
    /// Rendering passes: forward, loss and, where the signal needs it, backward.
    pub render: f64,
    /// Responses, deltas, targets.
    pub targets: f64,
    /// Encoding and writing.
    pub write: f64,
}

impl Seconds {
    /// All stages together.
    pub fn total(&self) -> f64 {
        self.by_stage().iter().map(|(_, seconds)| seconds).sum()
    }

    /// The stages by name.
    pub fn by_stage(&self) -> [(&'static str, f64); 5] {
        [
            ("scene", self.scene),
            ("sample", self.sample),
            ("render", self.render),
            ("targets", self.targets),
            ("write", self.write),
        ]
    }

    /// Adds another clip's.
    pub fn add(&mut self, other: &Self) {
        self.scene += other.scene;
        self.sample += other.sample;
        self.render += other.render;
        self.targets += other.targets;
        self.write += other.write;
    }
}

/// Adds the time since `from` to `to`, and starts anew.
pub(crate) fn lap(from: &mut Instant, to: &mut f64) {
    *to += from.elapsed().as_secs_f64();
    *from = Instant::now();
}

/// Rendering passes of a clip: views times branches.
pub fn num_passes(config: &TargetsConfig, views: usize) -> usize {
    let branches = match config.signal {
        Signal::Magnitude | Signal::Exact => 1,
        Signal::Response | Signal::Footprint => 1 + 2 * usize::from(config.rounds),
    };
    views * branches
}

/// Deltas of a scene, by the signal of the settings.
///
/// # Errors
/// When a position is not finite.
pub fn deltas(problem: &Problem<'_>, config: &TargetsConfig, seed: u64, seconds: &mut Seconds) -> Result<Deltas> {
    let mut clock = Instant::now();
    let rounds = Round::all(problem.set, config, seed);
    let by_round: Vec<ActionDeltas> = match config.signal {
        Signal::Response => {
            let neighbours = NeighbourSets::new(problem.set, &rounds, config.neighbours)?;
            lap(&mut clock, &mut seconds.sample);
            let gradients = branch_gradients(problem, &rounds);
            lap(&mut clock, &mut seconds.render);
            response_deltas(&gradients, &rounds, &neighbours, config)
        }
        Signal::Footprint => {
            lap(&mut clock, &mut seconds.sample);
            let found = footprints(problem, &rounds);
            lap(&mut clock, &mut seconds.render);
            footprint_deltas(found)
        }
        Signal::Magnitude => {
            lap(&mut clock, &mut seconds.sample);
            let gradients = branch_gradients(problem, &[]);
            lap(&mut clock, &mut seconds.render);
            magnitude_deltas(&gradients.original, &rounds)
        }
        Signal::Exact => {
            lap(&mut clock, &mut seconds.sample);
            let found = exact(problem);
            lap(&mut clock, &mut seconds.render);
            of_rounds(&found, &rounds)
        }
    };
    let merged = merge_rounds(&rounds, &by_round);
    lap(&mut clock, &mut seconds.targets);
    Ok(merged)
}

/// The targets of a scene.
///
/// # Errors
/// When a position is not finite.
pub fn generate(
    scene: PredictedScene,
    config: &TargetsConfig,
    seed: u64,
    seconds: &mut Seconds,
) -> Result<ClipTargets> {
    let problem = Problem { set: &scene.set, views: &scene.views, weights: LossWeights::default() };
    let found = deltas(&problem, config, seed, seconds)?;
    let mut clock = Instant::now();
    let (prune, prune_mask) = stored(&found.actions.prune);
    let (add, add_mask) = stored(&found.actions.add);
    let Targets { prune, add, moments } = targets([&prune, &add], [&prune_mask, &add_mask], config);
    let mut set = scene.set;
    set.drop_background();
    let clip = ClipTargets {
        index: found.index,
        samples: found.samples,
        prune,
        add,
        moments: moments.map(|moments| [moments.mean, moments.deviation]),
        gaussians: set.attributes,
        times: set.times,
        frames: Some(set.frames),
        velocities: set.velocities,
        features: scene.features,
    };
    lap(&mut clock, &mut seconds.targets);
    Ok(clip)
}
