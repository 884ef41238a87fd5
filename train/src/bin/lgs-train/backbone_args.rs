//! Flags of `backbone`.

use std::path::PathBuf;

use clap::Args;
use lgs_train::stages::settings::Settings;

use crate::stage_args::{Defaults, RenderingArgs, RunArgs};

const DEFAULTS: Defaults = Defaults { steps: 20_000, rate: 1e-3, calibration: 60 };

/// Flags of `backbone`.
#[derive(Clone, Debug, Args)]
pub(crate) struct BackboneArgs {
    /// Size of the model; of a new run from nothing [default: that of --weights or --resume]
    #[arg(long, value_name = "JSON", required_unless_present_any = ["resume", "weights"], conflicts_with = "weights")]
    pub(crate) config: Option<PathBuf>,
    /// Weights to start from, as this stage wrote them; of a new run [default: none]
    #[arg(long, value_name = "FILE")]
    pub(crate) weights: Option<PathBuf>,
    /// Share of the steps with random pruning and copying, 0 to 1
    #[arg(long, value_name = "X", default_value_t = 0.3)]
    pub(crate) perturbed: f64,
    /// Share of the steps whose scene is pruned by exact effects, to 35 to 95 % of it, between prediction and refinement, 0 to 1
    #[arg(long, value_name = "X", default_value_t = 0.0)]
    pub(crate) pruned: f64,
    #[command(flatten)]
    pub(crate) rendering: RenderingArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

impl BackboneArgs {
    /// The settings of a new run.
    pub(crate) fn settings(&self) -> Settings {
        let settings = self.rendering.settings(self.run.optimisation(DEFAULTS));
        Settings { perturbed: self.perturbed, pruned: self.pruned, ..settings }
    }
}
