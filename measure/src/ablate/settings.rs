//! What is measured on every clip.

use lgs_engine::densify::Limit;
use serde::{Deserialize, Serialize};

use crate::error::{MeasureError, Result};

/// Steps of the learned refinement that the system is used with.
pub const STEPS: usize = 3;

/// What is measured on a clip.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Most steps of the learned refinement, at least [`STEPS`].
    pub refine_steps: usize,
    /// Numbers of passes of per-scene optimisation after which the held-out views are measured, ascending, without 0.
    pub adam: Vec<usize>,
    /// Whether per-scene optimisation is also begun at the initial Gaussians, where no network has been.
    pub adam_from_start: bool,
    /// Most views that a step of per-scene optimisation looks at; `None` for one.
    pub adam_views: Option<std::num::NonZeroUsize>,
    /// Scores above which primitives are pruned and copied: the rows of the table of thresholds.
    pub thresholds: Vec<f32>,
    /// Largest numbers of primitives of the `LiDAR` branch, met by the policy and by chance.
    #[serde(default)]
    pub limits: Vec<Limit>,
    /// Seed of random density, copies and views in turns.
    pub seed: u64,
}

impl Settings {
    /// Fails for the first value out of its range.
    ///
    /// # Errors
    /// The first value out of its range.
    pub fn validate(&self) -> Result<()> {
        if !(STEPS..=100).contains(&self.refine_steps) {
            return Err(MeasureError::unfit("refine-steps", format!("{STEPS} to 100"), self.refine_steps));
        }
        if !self.adam.is_sorted_by(|a, b| a < b) || self.adam.first() == Some(&0) {
            return Err(MeasureError::unfit("adam", "ascending numbers from 1 on", format!("{:?}", self.adam)));
        }
        match self.thresholds.iter().find(|theta| !(0.0..=1.0).contains(*theta)) {
            Some(theta) => Err(MeasureError::unfit("thresholds", "scores from 0 to 1", theta)),
            None => Ok(()),
        }
    }

    /// The settings with no more than `most` passes of per-scene optimisation.
    #[must_use]
    pub fn with_at_most(&self, most: usize) -> Self {
        Self { adam: self.adam.iter().copied().filter(|&steps| steps <= most).collect(), ..self.clone() }
    }
}
