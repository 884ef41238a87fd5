//! Flags of `ablate`.

use std::path::PathBuf;

use clap::Args;
use lgs_engine::{densify::Limit, gaussians::motion::Motion, network::source::ModelSource, pipeline::HoldOut};
use lgs_formats::image::ImageSize;
use lgs_measure::{
    ablate::{job::Short, settings::Settings},
    clips::Choice,
};

/// `--motion`.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(crate) enum MotionArg {
    /// From input sweeps that are registered to each other
    Registered,
    /// All are zero
    None,
}

impl MotionArg {
    const fn motion(self) -> Motion {
        match self {
            Self::Registered => Motion::Registered,
            Self::None => Motion::None,
        }
    }
}

/// Flags of `ablate`.
#[derive(Clone, Debug, Args)]
pub(crate) struct AblateArgs {
    /// Weights to measure: a file, or `tiny`, which ship in the program
    #[arg(long, value_name = "FILE|tiny")]
    pub(crate) weights: ModelSource,
    /// Scenes that means and tests are taken over: clip directories, or directories of such [default: none]
    #[arg(long, value_name = "DIR", num_args = 1..)]
    pub(crate) scenes: Vec<PathBuf>,
    /// At most so many scenes [default: all]
    #[arg(long, value_name = "N")]
    pub(crate) count: Option<usize>,
    /// Size of the scenes' images
    #[arg(long, value_name = "HxW", default_value = "128x256")]
    pub(crate) image_size: ImageSize,
    /// Frames of the scenes that are held out: odd, every:N, or indices
    #[arg(long, value_name = "RULE", default_value = "odd")]
    pub(crate) hold_out: HoldOut,
    /// At most so many frames of a scene [default: all]
    #[arg(long, value_name = "N")]
    pub(crate) frames: Option<usize>,
    /// Where the initial velocities in the scenes come from
    #[arg(long, value_enum, default_value_t = MotionArg::Registered)]
    pub(crate) motion: MotionArg,
    /// A clip that stands for itself, with its own options; may be given several times [default: none]
    #[arg(
        long = "clip",
        value_name = "DIR[;hold-out=RULE][;cameras=A,B][;image-size=HxW][;frames=N][;motion=registered|none]"
    )]
    pub(crate) clips: Vec<Choice>,
    /// Most steps of the learned refinement
    #[arg(long, value_name = "N", default_value_t = 5)]
    pub(crate) refine_steps: usize,
    /// Numbers of passes of per-scene optimisation (Adam) after which the held-out views are measured
    #[arg(long, value_name = "A,B", value_delimiter = ',', default_values_t = [3, 10, 30, 60, 100, 200, 300])]
    pub(crate) adam: Vec<usize>,
    /// Begins per-scene optimisation at the initial Gaussians too
    #[arg(long)]
    pub(crate) adam_from_start: bool,
    /// Input views that a step of per-scene optimisation looks at, in random turns [default: 1]
    #[arg(long, value_name = "N")]
    pub(crate) adam_views: Option<std::num::NonZeroUsize>,
    /// Most passes of per-scene optimisation on scenes after the first --long-scenes [default: no limit]
    #[arg(long, value_name = "N")]
    pub(crate) adam_most: Option<usize>,
    /// Scenes that --adam-most does not concern
    #[arg(long, value_name = "N", default_value_t = 4)]
    pub(crate) long_scenes: usize,
    /// Thresholds of the policy, for pruning and adding alike, that are tried
    #[arg(long, value_name = "A,B", value_delimiter = ',', default_values_t = [0.5, 0.6, 0.7, 0.8, 0.9])]
    pub(crate) thresholds: Vec<f32>,
    /// Largest numbers of LiDAR Gaussians, or shares of those before, that the policy's rank and chance are held to
    #[arg(long, value_name = "P%,N", value_delimiter = ',', default_values_t = [Limit::Percent(70), Limit::Percent(40)])]
    pub(crate) limits: Vec<Limit>,
    /// Weights of LPIPS v0.1 with its squeeze trunk [default: none, and LPIPS is not measured]
    #[arg(long, value_name = "FILE")]
    pub(crate) lpips_weights: Option<PathBuf>,
    /// Seed of everything that is drawn at random
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub(crate) seed: u64,
    /// Directory of the results; clips that it holds already are not measured again
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Threads [default: all cores]; the figures do not depend on it
    #[arg(long, value_name = "N")]
    pub(crate) threads: Option<std::num::NonZeroUsize>,
}

impl AblateArgs {
    /// How a scene is read.
    pub(crate) fn scene(&self, dir: PathBuf) -> Choice {
        Choice {
            image_size: Some(self.image_size),
            hold_out: self.hold_out.clone(),
            num_frames: self.frames,
            motion: self.motion.motion(),
            ..Choice::new(dir)
        }
    }

    /// What is measured.
    pub(crate) fn settings(&self) -> Settings {
        Settings {
            refine_steps: self.refine_steps,
            adam: self.adam.clone(),
            adam_from_start: self.adam_from_start,
            adam_views: self.adam_views,
            thresholds: self.thresholds.clone(),
            limits: self.limits.clone(),
            seed: self.seed,
        }
    }

    /// The limit to what per-scene optimisation costs.
    pub(crate) fn short(&self) -> Option<Short> {
        self.adam_most.map(|most| Short { after: self.long_scenes, most })
    }
}
