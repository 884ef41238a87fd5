//! What a run of training is made from, apart from clips and model; a checkpoint keeps it.

use serde::{Deserialize, Serialize};

use super::schedule::Schedule;
use crate::error::{Result, TrainError};

/// Settings of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Decides the initial weights and every draw.
    pub seed: u64,
    /// The learning rate over the steps.
    pub schedule: Schedule,
    /// First steps, in which the statistics of normalisation follow the scenes and the weights stay as they are. All later steps normalise
    /// by these statistics, exactly as inference does: statistics of the one scene at hand would make another function of the network.
    pub calibration: u64,
    /// Decoupled weight decay of what convolutions and linear layers multiply by.
    pub weight_decay: f64,
    /// Largest norm of the whole gradient.
    pub max_gradient: f64,
    /// Decay of the average of the weights that is kept for inference.
    pub average: f64,
    /// Largest crop, height and width, pixels.
    pub crop: [usize; 2],
    /// Largest number of input views of a step.
    pub max_views: usize,
    /// Refinement steps.
    pub refine_steps: usize,
    /// Weight of the views of other frames in the loss; the input views have the rest.
    pub target_share: f64,
    /// Share of the steps in which primitives are pruned and copied at random between prediction and refinement.
    pub perturbed: f64,
}

impl Settings {
    /// Nothing.
    ///
    /// # Errors
    /// The first value out of its range.
    pub fn validate(&self) -> Result<()> {
        let shares = [("average", self.average), ("target_share", self.target_share), ("perturbed", self.perturbed)];
        for (name, value) in shares {
            if !(0.0..=1.0).contains(&value) {
                return Err(TrainError::config(name, "0 to 1", value));
            }
        }
        for (name, value) in [("weight_decay", self.weight_decay), ("max_gradient", self.max_gradient)] {
            if !(0.0..=1e6).contains(&value) {
                return Err(TrainError::config(name, "0 to 1000000", value));
            }
        }
        if self.crop.iter().any(|side| !(16..=4096).contains(side)) {
            return Err(TrainError::config("crop", "sides of 16 to 4096 pixels", format!("{:?}", self.crop)));
        }
        if !(1..=64).contains(&self.max_views) {
            return Err(TrainError::config("max_views", "1 to 64", self.max_views));
        }
        if !(0..=16).contains(&self.refine_steps) {
            return Err(TrainError::config("refine_steps", "0 to 16", self.refine_steps));
        }
        self.schedule.validate()
    }

    /// Whether a step only measures statistics.
    pub fn calibrates(&self, step: u64) -> bool {
        step < self.calibration
    }
}
