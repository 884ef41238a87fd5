//! Flags that stages of training share.

use std::{num::NonZeroUsize, path::PathBuf};

use clap::Args;
use lgs_engine::pipeline::HoldOut;
use lgs_formats::image::ImageSize;
use lgs_train::stages::{
    schedule::Schedule,
    settings::{Optimisation, Settings},
};

/// Flags of every stage.
#[derive(Clone, Debug, Args)]
pub(crate) struct RunArgs {
    /// Directory of checkpoints, weights, tables and pictures
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Goes on from the checkpoint in --out, with its settings; --steps may lengthen the run
    #[arg(long)]
    pub(crate) resume: bool,
    /// Steps in all [default: 20000, policy 15000; or the checkpoint's]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    pub(crate) steps: Option<u64>,
    /// Decides the first weights and every draw
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub(crate) seed: u64,
    /// Largest learning rate [default: 1e-3, finetune 2e-4]
    #[arg(long, value_name = "X")]
    pub(crate) rate: Option<f64>,
    /// Steps over which the learning rate rises
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub(crate) warm_up: u64,
    /// First steps, which only measure the statistics that normalisation then keeps [default: 60, finetune 0]
    #[arg(long, value_name = "N")]
    pub(crate) calibration: Option<u64>,
    /// Weight decay
    #[arg(long, value_name = "X", default_value_t = 0.01)]
    pub(crate) weight_decay: f64,
    /// Largest norm of the gradient
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    pub(crate) max_gradient: f64,
    /// Decay of the average of the weights
    #[arg(long, value_name = "X", default_value_t = 0.998)]
    pub(crate) average: f64,
    /// Steps between checkpoints
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) checkpoint_every: u64,
    /// Steps between validations
    #[arg(long, value_name = "N", default_value_t = 250, value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) validate_every: u64,
    /// Threads [default: all cores]; the weights do not depend on it
    #[arg(long, value_name = "N")]
    pub(crate) threads: Option<NonZeroUsize>,
}

/// What a stage takes where nobody says.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Defaults {
    /// Steps.
    pub(crate) steps: u64,
    /// Largest learning rate.
    pub(crate) rate: f64,
    /// Steps of calibration.
    pub(crate) calibration: u64,
}

/// Flags of the stages by the rendering loss.
#[derive(Clone, Debug, Args)]
pub(crate) struct RenderingArgs {
    /// Clips to learn from: clip directories, or directories of such
    #[arg(long, value_name = "DIR", required = true, num_args = 1..)]
    pub(crate) clips: Vec<PathBuf>,
    /// Frames of these clips that are never read: none, odd, every:N, or indices
    #[arg(long, value_name = "RULE", default_value = "none")]
    pub(crate) hold_out: HoldOut,
    /// Clips to measure on, as --clips; their odd frames are held out [default: none]
    #[arg(long, value_name = "DIR", num_args = 0..)]
    pub(crate) validation: Vec<PathBuf>,
    /// At most so many validation clips
    #[arg(long, value_name = "N", default_value_t = 6)]
    pub(crate) validation_clips: usize,
    /// Size of the images of validation clips, pixels
    #[arg(long, value_name = "HxW", default_value = "160x320")]
    pub(crate) validation_size: ImageSize,
    /// Largest crop, pixels
    #[arg(long, value_name = "HxW", default_value = "128x256")]
    pub(crate) crop: ImageSize,
    /// Most input views of a step
    #[arg(long, value_name = "N", default_value_t = 4)]
    pub(crate) max_views: usize,
    /// Refinement steps
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub(crate) refine_steps: usize,
    /// Weight of the views of other frames in the loss, 0 to 1
    #[arg(long, value_name = "X", default_value_t = 0.6)]
    pub(crate) target_share: f64,
    /// Share of the steps whose scene is mirrored, 0 to 1
    #[arg(long, value_name = "X", default_value_t = 0.5)]
    pub(crate) mirrored: f64,
    /// Largest standard deviation of the noise of input images, of a range of colours of 1
    #[arg(long, value_name = "X", default_value_t = 0.02)]
    pub(crate) noise: f64,
    /// Weight of the errors of velocities that a clip's tracked boxes tell, per metre a second
    #[arg(long, value_name = "X", default_value_t = 0.02)]
    pub(crate) velocity: f64,
    /// Weight of the peak signal-to-noise ratio beside the loss, per decibel
    #[arg(long, value_name = "X", default_value_t = 0.01)]
    pub(crate) psnr: f64,
}

impl RunArgs {
    /// How the weights of a new run are moved.
    pub(crate) fn optimisation(&self, defaults: Defaults) -> Optimisation {
        let steps = self.steps.unwrap_or(defaults.steps);
        let peak = self.rate.unwrap_or(defaults.rate);
        Optimisation {
            seed: self.seed,
            schedule: Schedule { steps, warm_up: self.warm_up.min(steps), peak },
            calibration: self.calibration.unwrap_or(defaults.calibration),
            weight_decay: self.weight_decay,
            max_gradient: self.max_gradient,
            average: self.average,
        }
    }
}

impl RenderingArgs {
    /// The settings of a new run without random changes of the set and without a policy.
    pub(crate) fn settings(&self, optimisation: Optimisation) -> Settings {
        let Optimisation { seed, schedule, calibration, weight_decay, max_gradient, average } = optimisation;
        Settings {
            seed,
            schedule,
            calibration,
            weight_decay,
            max_gradient,
            average,
            crop: [self.crop.height, self.crop.width],
            max_views: self.max_views,
            refine_steps: self.refine_steps,
            target_share: self.target_share,
            perturbed: 0.0,
            pruned: 0.0,
            mirrored: self.mirrored,
            noise: self.noise,
            velocity: self.velocity,
            psnr: self.psnr,
            thresholds: None,
            max_gaussians: None,
        }
    }
}
