//! What was found on a clip: one JSON file each, written when the clip is done, read again when the work goes on.

use std::path::{Path, PathBuf};

use lgs_train::velocity::VelocityErrors;
use serde::{Deserialize, Serialize};

use super::settings::Settings;
use crate::{
    clips::RecordedChoice,
    error::Result,
    means::Means,
    records::{file_stem, read_record, write_record},
};

/// The value of `format` in the file of a clip.
pub const CLIP_FORMAT: &str = "lgs-ablation-clip/1";

/// What decides the result of a clip: a record of other causes is not used again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AblationKey {
    /// [`CLIP_FORMAT`].
    pub format: String,
    /// SHA-256 of the weights.
    pub weights: String,
    /// SHA-256 of the weights of LPIPS; `None` where it is not measured.
    pub lpips: Option<String>,
    /// Where the clip says that it comes from.
    pub source: String,
    /// How it was read.
    pub choice: RecordedChoice,
    /// What was measured.
    pub settings: Settings,
}

/// The figures after some steps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Point {
    /// Steps.
    pub steps: usize,
    /// Figures of the held-out views.
    pub figures: Means,
    /// Loss over the input views that led to the last step; `None` where there was none.
    pub loss: Option<f64>,
    /// Seconds that the steps took, without what was measured.
    pub seconds: f64,
}

/// One of the curves of a record.
pub type CurveOf = fn(&AblationRecord) -> &Vec<Point>;

/// A way to use the network, refined by [`STEPS`](super::settings::STEPS) steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Variant {
    /// Its name.
    pub name: String,
    /// Figures of the held-out views.
    pub figures: Means,
    /// Gaussians of the `LiDAR` branch that were pruned.
    pub pruned: usize,
    /// Copies that were added.
    pub added: usize,
    /// Seconds from the initial Gaussians on.
    pub seconds: f64,
}

/// Everything that was found on a clip.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AblationRecord {
    /// What decides it.
    pub key: AblationKey,
    /// Name of the clip.
    pub clip: String,
    /// Input and held-out views.
    pub views: [usize; 2],
    /// Initial Gaussians of the `LiDAR` branch and of the background.
    pub gaussians: [usize; 2],
    /// Of the initial Gaussians.
    pub start: Means,
    /// The learned refinement from 0 steps on; fewer points than asked for where a step did not help and was taken back.
    pub learned: Vec<Point>,
    /// Per-scene optimisation from where the learned refinement starts, from 0 steps on.
    pub adam: Vec<Point>,
    /// Per-scene optimisation from the initial Gaussians; empty where it was not asked for.
    pub adam_from_start: Vec<Point>,
    /// Ways to use the network.
    pub variants: Vec<Variant>,
    /// Why the policy was left out; `None` where it was not.
    pub policy_skipped: Option<String>,
    /// Errors of the velocities after the prediction and after the refinement; `None` where the clip tracks nothing.
    pub velocity: Option<[VelocityErrors; 2]>,
    /// Seconds of the initial Gaussians, and of the network's prediction.
    pub seconds: [f64; 2],
}

impl AblationRecord {
    /// The file of clip number `index`.
    pub fn file(dir: &Path, index: usize, clip: &str) -> PathBuf {
        dir.join(format!("{}.json", file_stem(index, clip)))
    }

    /// The record in `file`; `None` where there is none, or one of other key.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn read(file: &Path, key: &AblationKey) -> Result<Option<Self>> {
        Ok(read_record(file)?.filter(|record: &Self| &record.key == key))
    }

    /// Writes the record into `file`.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, file: &Path) -> Result<()> {
        write_record(file, self)
    }

    /// The learned refinement after so many steps: its last point where it ended before.
    pub fn learned_at(&self, steps: usize) -> Option<&Point> {
        self.learned.iter().take_while(|point| point.steps <= steps).last()
    }

    /// The point of a curve after exactly so many steps.
    pub fn at(curve: &[Point], steps: usize) -> Option<&Point> {
        curve.iter().find(|point| point.steps == steps)
    }

    /// A way to use the network.
    pub fn variant(&self, name: &str) -> Option<&Variant> {
        self.variants.iter().find(|variant| variant.name == name)
    }
}
