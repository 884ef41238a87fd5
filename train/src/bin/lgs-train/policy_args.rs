//! Flags of `policy`.

use std::path::PathBuf;

use clap::Args;
use lgs_train::stages::settings::PolicySettings;

use crate::stage_args::{Defaults, RunArgs};

const DEFAULTS: Defaults = Defaults { steps: 15_000, rate: 1e-3, calibration: 60 };

/// Flags of `policy`.
#[derive(Clone, Debug, Args)]
pub(crate) struct PolicyArgs {
    /// Weights whose policy is trained, as `backbone` wrote them; shards must have been made with them
    #[arg(long, value_name = "FILE")]
    pub(crate) weights: PathBuf,
    /// Folders of targets, as lgs-targetgen wrote them; all of one signal
    #[arg(long, value_name = "DIR", required = true, num_args = 1..)]
    pub(crate) shards: Vec<PathBuf>,
    /// Every so many clips one is held out and measured on; 0 for none
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub(crate) hold_out_every: usize,
    /// At most so many clips are measured on
    #[arg(long, value_name = "N", default_value_t = 8)]
    pub(crate) validation_clips: usize,
    /// Clips that the shards were made of, for features that shards do not hold: what lgs-targetgen was given [default: none]
    #[arg(long, value_name = "CLIPS", num_args = 1..)]
    pub(crate) clips: Vec<PathBuf>,
    /// Computes all features from --clips with --weights; targets may then have been made with other weights
    #[arg(long, requires = "clips")]
    pub(crate) recompute: bool,
    /// Exponent of the weight of a target, (2 |y - 1/2|)^gamma
    #[arg(long, value_name = "X", default_value_t = 2.0)]
    pub(crate) gamma: f64,
    /// Most primitives of a step: what lies around one that is drawn
    #[arg(long, value_name = "N", default_value_t = 30_000)]
    pub(crate) max_primitives: usize,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

impl PolicyArgs {
    /// The settings of a new run.
    pub(crate) fn settings(&self) -> PolicySettings {
        PolicySettings {
            optimisation: self.run.optimisation(DEFAULTS),
            gamma: self.gamma,
            max_primitives: self.max_primitives,
        }
    }
}
