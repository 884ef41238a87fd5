//! What a run of training is made from, apart from clips and model; a checkpoint keeps it.

use lgs_engine::densify::{Limit, Thresholds};
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use super::schedule::Schedule;
use crate::error::{Result, TrainError};

/// Which stage of training a run is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StageName {
    /// Prediction, query and refinement by the rendering loss.
    #[default]
    Backbone,
    /// The policy by its targets.
    Policy,
    /// As the first, the policy's decisions applied.
    Finetune,
}

/// What every stage has: how its weights are moved.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Optimisation {
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
}

/// Settings of the run of a stage.
pub trait RunSettings: Clone + std::fmt::Debug + PartialEq + Serialize + DeserializeOwned + Send + Sync {
    /// Which stage this is.
    fn stage(&self) -> StageName;

    /// How weights are moved.
    fn optimisation(&self) -> Optimisation;

    /// The schedule, to lengthen a run.
    fn schedule_mut(&mut self) -> &mut Schedule;

    /// Fails when a value is out of its range.
    ///
    /// # Errors
    /// The first value out of its range.
    fn validate(&self) -> Result<()>;

    /// Whether a step only measures statistics.
    fn calibrates(&self, step: u64) -> bool {
        step < self.optimisation().calibration
    }
}

/// Settings of a run by the rendering loss.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// As [`Optimisation::seed`].
    pub seed: u64,
    /// As [`Optimisation::schedule`].
    pub schedule: Schedule,
    /// As [`Optimisation::calibration`].
    pub calibration: u64,
    /// As [`Optimisation::weight_decay`].
    pub weight_decay: f64,
    /// As [`Optimisation::max_gradient`].
    pub max_gradient: f64,
    /// As [`Optimisation::average`].
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
    /// Share of the steps in which the scene is pruned by exact effects between prediction and refinement, to a share of it that is drawn.
    #[serde(default)]
    pub pruned: f64,
    /// Share of the steps whose scene is mirrored.
    #[serde(default)]
    pub mirrored: f64,
    /// Largest standard deviation of the noise of input images, of a range of colours of 1.
    #[serde(default)]
    pub noise: f64,
    /// Weight of the errors of velocities that tracked boxes tell.
    #[serde(default)]
    pub velocity: f64,
    /// Weight of the peak signal-to-noise ratio, per decibel.
    #[serde(default)]
    pub psnr: f64,
    /// Scores above which the policy prunes and adds; `None`: it has no say.
    #[serde(default)]
    pub thresholds: Option<[f32; 2]>,
    /// Most primitives that it leaves; `None` for no limit.
    #[serde(default)]
    pub max_gaussians: Option<Limit>,
}

/// How a policy's scores are acted on: above which, and down to how many primitives.
pub type SetUpdate = (Thresholds, Option<Limit>);

impl Settings {
    /// How the policy's scores are acted on; `None`: not at all.
    pub fn update(&self) -> Option<SetUpdate> {
        self.thresholds.map(|[prune, add]| (Thresholds { prune, add }, self.max_gaussians))
    }
}

impl Optimisation {
    /// Fails when a value is out of its range.
    ///
    /// # Errors
    /// The first value out of its range.
    pub fn validate(&self) -> Result<()> {
        in_range("average", self.average, 1.0)?;
        in_range("weight_decay", self.weight_decay, 1e6)?;
        in_range("max_gradient", self.max_gradient, 1e6)?;
        self.schedule.validate()
    }
}

/// # Errors
/// When the value is not from 0 to `most`.
fn in_range(name: &str, value: f64, most: f64) -> Result<()> {
    if (0.0..=most).contains(&value) {
        return Ok(());
    }
    Err(TrainError::config(name, format!("0 to {most}"), value))
}

impl RunSettings for Settings {
    fn stage(&self) -> StageName {
        if self.thresholds.is_some() { StageName::Finetune } else { StageName::Backbone }
    }

    fn optimisation(&self) -> Optimisation {
        let Self { seed, schedule, calibration, weight_decay, max_gradient, average, .. } = *self;
        Optimisation { seed, schedule, calibration, weight_decay, max_gradient, average }
    }

    fn schedule_mut(&mut self) -> &mut Schedule {
        &mut self.schedule
    }

    fn validate(&self) -> Result<()> {
        self.optimisation().validate()?;
        in_range("velocity", self.velocity, 1e6)?;
        in_range("psnr", self.psnr, 1e6)?;
        let shares = [
            ("target_share", self.target_share),
            ("perturbed", self.perturbed),
            ("pruned", self.pruned),
            ("mirrored", self.mirrored),
            ("noise", self.noise),
        ];
        shares.into_iter().try_for_each(|(name, value)| in_range(name, value, 1.0))?;
        if self.crop.iter().any(|side| !(16..=4096).contains(side)) {
            return Err(TrainError::config("crop", "sides of 16 to 4096 pixels", format!("{:?}", self.crop)));
        }
        if !(1..=64).contains(&self.max_views) {
            return Err(TrainError::config("max_views", "1 to 64", self.max_views));
        }
        if !(0..=16).contains(&self.refine_steps) {
            return Err(TrainError::config("refine_steps", "0 to 16", self.refine_steps));
        }
        let thresholds = self.thresholds.iter().flatten();
        thresholds.copied().try_for_each(|theta| in_range("threshold", f64::from(theta), 1.0))
    }
}

/// Settings of a run of the policy.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicySettings {
    /// How weights are moved.
    pub optimisation: Optimisation,
    /// Exponent of the weight of a target: far from 1/2 counts, near it does not.
    pub gamma: f64,
    /// Most primitives of a step: what lies around one that is drawn.
    pub max_primitives: usize,
}

impl RunSettings for PolicySettings {
    fn stage(&self) -> StageName {
        StageName::Policy
    }

    fn optimisation(&self) -> Optimisation {
        self.optimisation
    }

    fn schedule_mut(&mut self) -> &mut Schedule {
        &mut self.optimisation.schedule
    }

    fn validate(&self) -> Result<()> {
        self.optimisation.validate()?;
        in_range("gamma", self.gamma, 16.0)?;
        if self.max_primitives == 0 {
            return Err(TrainError::config("max_primitives", "1 or more", 0));
        }
        Ok(())
    }
}
