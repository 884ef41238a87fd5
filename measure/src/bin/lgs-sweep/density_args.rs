//! Flags of `density`.

use std::path::PathBuf;

use clap::Args;
use lgs_engine::network::source::ModelSource;
use lgs_measure::{
    clips::Choice,
    density::{record::DensitySettings, signal::Signal},
};

/// Flags of `density`.
#[derive(Clone, Debug, Args)]
pub(crate) struct DensityArgs {
    /// Clips, each with options of its own where it needs some; a directory of clips stands for all of them
    #[arg(
        value_name = "DIR[;hold-out=RULE][;cameras=A,B][;image-size=HxW][;frames=N]",
        required = true,
        num_args = 1..
    )]
    pub(crate) clips: Vec<Choice>,
    /// Weights to measure: a file, or `tiny`, which ship in the program
    #[arg(long, value_name = "FILE|tiny", default_value = "tiny")]
    pub(crate) weights: ModelSource,
    /// What decides which Gaussians stay: exact, oracle (exact effects in held-out views too: a ceiling), opacity, entropy, chance
    #[arg(long, value_name = "A,B", value_delimiter = ',', default_values_t = Signal::ALL)]
    pub(crate) signals: Vec<Signal>,
    /// Percentages of the Gaussians that stay, 1 to 99
    #[arg(long, value_name = "A,B", value_delimiter = ',', default_values_t = [70, 50, 25, 12])]
    pub(crate) percents: Vec<u32>,
    /// Steps of the learned refinement after it
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub(crate) refine_steps: usize,
    /// Passes of per-scene optimisation after it, instead; 0: not measured
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub(crate) adam: usize,
    /// Seed of chance
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub(crate) seed: u64,
    /// Directory of the results; clips that it holds already are not measured again
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Threads [default: all cores]; the figures do not depend on it
    #[arg(long, value_name = "N")]
    pub(crate) threads: Option<std::num::NonZeroUsize>,
}

impl DensityArgs {
    /// What is measured on a clip.
    pub(crate) fn settings(&self) -> DensitySettings {
        let Self { signals, percents, refine_steps, adam, seed, .. } = self;
        DensitySettings {
            signals: signals.clone(),
            percents: percents.clone(),
            refine_steps: *refine_steps,
            adam: *adam,
            seed: *seed,
        }
    }
}
