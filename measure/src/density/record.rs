//! What was found on a clip: one JSON file each, written when the clip is done, read again when the work goes on.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::signal::Signal;
use crate::{
    clips::RecordedChoice,
    error::{MeasureError, Result},
    means::Means,
    records::read_record,
};

/// The value of `format` in the file of a clip.
pub const CLIP_FORMAT: &str = "lgs-density-clip/1";
/// Most steps of either refinement.
const MOST_STEPS: usize = 1000;

/// What is measured on a clip.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DensitySettings {
    /// What decides which Gaussians stay.
    pub signals: Vec<Signal>,
    /// Percentages of the Gaussians that stay.
    pub percents: Vec<u32>,
    /// Steps of the learned refinement after it.
    pub refine_steps: usize,
    /// Passes of per-scene optimisation after it, instead; 0 for none.
    pub adam: usize,
    /// Seed of chance.
    pub seed: u64,
}

/// What decides the result of a clip: a record of other causes is not used again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DensityKey {
    /// [`CLIP_FORMAT`].
    pub format: String,
    /// SHA-256 of the weights.
    pub weights: String,
    /// Where the clip says that it comes from.
    pub source: String,
    /// How it was read.
    pub choice: RecordedChoice,
    /// What was measured.
    pub settings: DensitySettings,
}

/// What a number of Gaussians is worth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DensityPoint {
    /// What decided which of them stay; `None` where all do.
    pub signal: Option<Signal>,
    /// Percentage that stays.
    pub percent: u32,
    /// How many that are.
    pub gaussians: usize,
    /// Figures of the held-out views after the learned refinement.
    pub learned: Means,
    /// The same after per-scene optimisation instead, where it is measured.
    pub adam: Option<Means>,
}

/// Everything that was found on a clip.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DensityRecord {
    /// What decides it.
    pub key: DensityKey,
    /// Name of the clip.
    pub clip: String,
    /// Pixels of the input views.
    pub pixels: usize,
    /// All Gaussians first, then every signal at every percentage.
    pub points: Vec<DensityPoint>,
}

impl DensitySettings {
    /// Fails for the first value out of its range.
    ///
    /// # Errors
    /// The first value out of its range.
    pub fn validate(&self) -> Result<()> {
        if let Some(percent) = self.percents.iter().find(|percent| !(1..100).contains(*percent)) {
            return Err(MeasureError::unfit("percents", "percentages from 1 to 99", percent));
        }
        for (name, steps) in [("refine-steps", self.refine_steps), ("adam", self.adam)] {
            if steps > MOST_STEPS {
                return Err(MeasureError::unfit(name, format!("0 to {MOST_STEPS}"), steps));
            }
        }
        Ok(())
    }
}

impl DensityRecord {
    /// The record in a file; `None` where there is none, or one of other causes.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn read(file: &Path, key: &DensityKey) -> Result<Option<Self>> {
        Ok(read_record(file)?.filter(|record: &Self| record.key == *key))
    }

    /// The point of a signal at a percentage; `None` as the signal stands for all Gaussians.
    pub fn at(&self, signal: Option<Signal>, percent: u32) -> Option<&DensityPoint> {
        self.points.iter().find(|point| point.signal == signal && (signal.is_none() || point.percent == percent))
    }

    /// Percentage of the pixels of the input views that a number of Gaussians is.
    pub fn percent_of_pixels(&self, gaussians: usize) -> f64 {
        100.0 * gaussians as f64 / self.pixels.max(1) as f64
    }
}
