//! Flags of `backbone`.

use std::path::PathBuf;

use clap::Args;
use lgs_engine::pipeline::HoldOut;
use lgs_formats::image::ImageSize;
use lgs_train::stages::{schedule::Schedule, settings::Settings};

/// Flags of `backbone`.
#[derive(Clone, Debug, Args)]
pub(crate) struct BackboneArgs {
    /// Size of the model; of a new run
    #[arg(long, value_name = "JSON", required_unless_present = "resume")]
    pub(crate) config: Option<PathBuf>,
    /// Clips to learn from: clip directories, or directories of such
    #[arg(long, value_name = "DIR", required = true, num_args = 1..)]
    pub(crate) clips: Vec<PathBuf>,
    /// Frames of these clips that are never read: none, odd, every:N, or indices
    #[arg(long, value_name = "RULE", default_value = "none")]
    pub(crate) hold_out: HoldOut,
    /// Clips to measure on, as --clips; their odd frames are held out
    #[arg(long, value_name = "DIR", num_args = 0..)]
    pub(crate) validation: Vec<PathBuf>,
    /// At most so many validation clips
    #[arg(long, value_name = "N", default_value_t = 6)]
    pub(crate) validation_clips: usize,
    /// Size of the images of validation clips
    #[arg(long, value_name = "HxW", default_value = "160x320")]
    pub(crate) validation_size: ImageSize,
    /// Directory of checkpoints, tables and pictures
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Goes on from the checkpoint in --out, with its settings; --steps may lengthen the run
    #[arg(long)]
    pub(crate) resume: bool,
    /// Steps in all [default: 20000, or the checkpoint's]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    pub(crate) steps: Option<u64>,
    /// Decides the first weights and every draw
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub(crate) seed: u64,
    /// Largest learning rate
    #[arg(long, value_name = "X", default_value_t = 1e-3)]
    pub(crate) rate: f64,
    /// Steps over which the learning rate rises
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub(crate) warm_up: u64,
    /// First steps, which only measure the statistics that normalisation then keeps
    #[arg(long, value_name = "N", default_value_t = 60)]
    pub(crate) calibration: u64,
    /// Weight decay
    #[arg(long, value_name = "X", default_value_t = 0.01)]
    pub(crate) weight_decay: f64,
    /// Largest norm of the gradient
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    pub(crate) max_gradient: f64,
    /// Decay of the average of the weights
    #[arg(long, value_name = "X", default_value_t = 0.998)]
    pub(crate) average: f64,
    /// Largest crop
    #[arg(long, value_name = "HxW", default_value = "128x256")]
    pub(crate) crop: ImageSize,
    /// Most input views of a step
    #[arg(long, value_name = "N", default_value_t = 4)]
    pub(crate) max_views: usize,
    /// Refinement steps
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub(crate) refine_steps: usize,
    /// Weight of the views of other frames in the loss
    #[arg(long, value_name = "X", default_value_t = 0.6)]
    pub(crate) target_share: f64,
    /// Share of the steps with random pruning and copying
    #[arg(long, value_name = "X", default_value_t = 0.3)]
    pub(crate) perturbed: f64,
    /// Steps between checkpoints
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) checkpoint_every: u64,
    /// Steps between validations
    #[arg(long, value_name = "N", default_value_t = 250, value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) validate_every: u64,
    /// Threads [default: all cores]; the weights do not depend on it
    #[arg(long, value_name = "N")]
    pub(crate) threads: Option<std::num::NonZeroUsize>,
}

/// Steps of a run when nobody says.
const STEPS: u64 = 20_000;

impl BackboneArgs {
    /// The settings of a new run.
    pub(crate) fn settings(&self) -> Settings {
        let steps = self.steps.unwrap_or(STEPS);
        Settings {
            seed: self.seed,
            schedule: Schedule { steps, warm_up: self.warm_up.min(steps), peak: self.rate },
            calibration: self.calibration,
            weight_decay: self.weight_decay,
            max_gradient: self.max_gradient,
            average: self.average,
            crop: [self.crop.height, self.crop.width],
            max_views: self.max_views,
            refine_steps: self.refine_steps,
            target_share: self.target_share,
            perturbed: self.perturbed,
        }
    }
}
