//! Flags of `finetune`.

use std::path::PathBuf;

use clap::Args;
use lgs_engine::densify::Limit;
use lgs_train::stages::settings::Settings;

use crate::stage_args::{Defaults, RenderingArgs, RunArgs};

const DEFAULTS: Defaults = Defaults { steps: 20_000, rate: 2e-4, calibration: 0 };

/// Flags of `finetune`.
#[derive(Clone, Debug, Args)]
pub(crate) struct FinetuneArgs {
    /// Weights to start from, as `policy` wrote them; of a new run [default: those of --resume]
    #[arg(long, value_name = "FILE", required_unless_present = "resume")]
    pub(crate) weights: Option<PathBuf>,
    /// Score above which a primitive is pruned, 0 to 1
    #[arg(long, value_name = "X", default_value_t = 0.7)]
    pub(crate) theta_prune: f32,
    /// Score above which a primitive that stays gets a copy, 0 to 1
    #[arg(long, value_name = "X", default_value_t = 0.7)]
    pub(crate) theta_add: f32,
    /// Most LiDAR Gaussians that are left, a number or a share of those before such as 70%: the rest goes by rank [default: no limit]
    #[arg(long, value_name = "N|P%")]
    pub(crate) max_gaussians: Option<Limit>,
    #[command(flatten)]
    pub(crate) rendering: RenderingArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

impl FinetuneArgs {
    /// The settings of a new run.
    pub(crate) fn settings(&self) -> Settings {
        let settings = self.rendering.settings(self.run.optimisation(DEFAULTS));
        Settings { thresholds: Some([self.theta_prune, self.theta_add]), max_gaussians: self.max_gaussians, ..settings }
    }
}
