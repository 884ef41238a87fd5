//! The command line, parsed and checked without side effects.

use std::{num::NonZeroUsize, path::PathBuf};

use clap::{Args as Group, Parser, Subcommand, builder::RangedU64ValueParser};
use lgs_engine::network::source::ModelSource;
use lgs_formats::image::ImageSize;
use lgs_formats::jobs::Part;
use lgs_formats::targets::{Normalise, Signal, TargetsConfig, ZScore};
use serde::de::DeserializeOwned;

const MAX_THREADS: u64 = 1024;

/// Make the training targets of the densify policy: what pruning or copying a primitive does to its surroundings.
///
/// Reads clips, writes shards `targets-00000.safetensors`, ..., `manifest.json` and `report.html`. A clip that fails is recorded and
/// skipped; the job then ends with exit code 1 and a list. After an interruption the same command with --resume goes on.
#[derive(Clone, Debug, PartialEq, Parser)]
#[command(name = "lgs-targetgen", version, max_term_width = 110, args_conflicts_with_subcommands = true)]
#[command(subcommand_negates_reqs = true)]
pub(crate) struct Args {
    #[command(subcommand)]
    pub(crate) command: Option<Command>,

    #[command(flatten)]
    pub(crate) job: JobArgs,
}

#[derive(Clone, Debug, PartialEq, Subcommand)]
pub(crate) enum Command {
    /// Join the parts of a job into shards and one manifest
    Merge(MergeArgs),
    /// Make other targets from the raw deltas of shards; nothing is rendered
    Retarget(RetargetArgs),
    /// Check the size and SHA-256 of every shard against the manifest
    Verify(VerifyArgs),
    /// Measure how well the signals tell the true effect of single actions
    Fidelity(FidelityArgs),
}

/// The clips to make targets for, and how.
#[derive(Clone, Debug, PartialEq, Group)]
pub(crate) struct JobArgs {
    /// Clip directories, folders of clip directories, or list files with one clip directory a line
    #[arg(value_name = "CLIPS", required = true)]
    pub(crate) clips: Vec<PathBuf>,

    /// Folder to write to, made when it is missing
    #[arg(long, value_name = "DIR", required = true)]
    pub(crate) out: Option<PathBuf>,

    #[command(flatten)]
    pub(crate) scene: SceneArgs,

    #[command(flatten)]
    pub(crate) sampling: SamplingArgs,

    /// What the effect of an action is measured by: `response`: change of the neighbours' gradient responses; `footprint`: change
    /// of the loss under the primitive's own blending weights; `magnitude`: no intervention, the primitive's own response;
    /// `exact`: exact change of the loss without the primitive, and what its halves could gain, of all primitives without sampling
    #[arg(long, value_name = "WORD", default_value = "response", value_parser = word::<Signal>)]
    pub(crate) signal: Signal,

    /// Whose largest gradients the responses are divided by: `branch`: each branch by its own; `original`: all by those of the
    /// original branch
    #[arg(long, value_name = "WORD", default_value = "branch", value_parser = word::<Normalise>)]
    pub(crate) normalise: Normalise,

    #[command(flatten)]
    pub(crate) transform: TransformArgs,

    /// Store the decoder features of every primitive (f16), so that the policy trains without the network; needs --weights
    #[arg(long)]
    pub(crate) with_features: bool,

    /// Do the I-th of N equal shares of the clips [default: the share that a Slurm array task or a Kubernetes indexed job is
    /// told by its environment, else all clips]
    #[arg(long, value_name = "I/N")]
    pub(crate) part: Option<Part>,

    /// Most data of a shard, 10^6 bytes; a larger clip stands alone. The report at the end holds one shard in memory
    #[arg(long, value_name = "MB", default_value_t = 256, value_parser = RangedU64ValueParser::<u64>::new().range(1..=4000))]
    pub(crate) shard_mb: u64,

    /// Go on where an earlier run of the same job into the same folder ended
    #[arg(long)]
    pub(crate) resume: bool,

    /// Print what was done as JSON instead of a summary
    #[arg(long)]
    pub(crate) json: bool,
}

/// Where scenes come from.
#[derive(Clone, Debug, PartialEq, Group)]
pub(crate) struct SceneArgs {
    /// Network weights, a safetensors file; `tiny`: those that ship in the program; `random:FILE.json`: weights of a model config
    /// drawn from --seed; `none`: the initial Gaussians
    #[arg(long, value_name = "FILE|tiny|random:FILE.json|none", default_value = "none")]
    pub(crate) weights: ModelSource,

    /// Names of the cameras to use, separated by commas [default: all]
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    pub(crate) cameras: Option<Vec<String>>,

    /// Size to which every image is brought: height x width, pixels [default: each image's own]
    #[arg(long, value_name = "HxW")]
    pub(crate) image_size: Option<ImageSize>,

    /// Seed of everything that is drawn at random
    #[arg(long, value_name = "N", default_value_t = TargetsConfig::default().seed)]
    pub(crate) seed: u64,

    /// Threads to work with, 1 to 1024; the result does not depend on it [default: one per core]
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<u64>::new().range(1..=MAX_THREADS))]
    threads: Option<u64>,
}

/// How primitives are sampled.
#[derive(Clone, Debug, PartialEq, Group)]
pub(crate) struct SamplingArgs {
    /// Rounds of sampling, 1 to 100
    #[arg(long, value_name = "N", default_value_t = TargetsConfig::default().rounds, value_parser = clap::value_parser!(u8).range(1..=100))]
    pub(crate) rounds: u8,

    /// Probability with which a round samples a primitive, 0 to 1
    #[arg(long, value_name = "F", default_value_t = TargetsConfig::default().rho, value_parser = probability)]
    pub(crate) rho: f64,

    /// Nearest neighbours whose responses count, 1 to 64
    #[arg(long, value_name = "K", default_value_t = TargetsConfig::default().neighbours, value_parser = RangedU64ValueParser::<usize>::new().range(1..=64))]
    pub(crate) neighbours: usize,

    /// Standard deviation of a copy's displacement per axis, metres
    #[arg(long, value_name = "M", default_value_t = TargetsConfig::default().noise_m, value_parser = not_negative)]
    pub(crate) noise_m: f64,
}

/// How deltas become targets.
#[derive(Clone, Copy, Debug, PartialEq, Group)]
pub(crate) struct TransformArgs {
    /// Delta at which the logarithm begins to bend
    #[arg(long, value_name = "F", default_value_t = TargetsConfig::default().log_scale, value_parser = positive)]
    pub(crate) log_scale: f64,

    /// Population that deltas are compared with: `joint`: both actions together; `per-action`: each by itself
    #[arg(long, value_name = "WORD", default_value = "joint", value_parser = word::<ZScore>)]
    pub(crate) zscore: ZScore,
}

#[derive(Clone, Debug, PartialEq, Group)]
pub(crate) struct MergeArgs {
    /// Folders that the parts wrote to
    #[arg(value_name = "DIRS", required = true)]
    pub(crate) folders: Vec<PathBuf>,

    /// Folder of the whole job [default: the first of DIRS]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,

    /// Most data of a shard, 10^6 bytes; a larger clip stands alone. The report at the end holds one shard in memory
    #[arg(long, value_name = "MB", default_value_t = 256, value_parser = RangedU64ValueParser::<u64>::new().range(1..=4000))]
    pub(crate) shard_mb: u64,
}

#[derive(Clone, Debug, PartialEq, Group)]
pub(crate) struct RetargetArgs {
    /// Folder with a manifest
    #[arg(value_name = "DIR")]
    pub(crate) folder: PathBuf,

    /// Folder to write to, made when it is missing
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,

    #[command(flatten)]
    pub(crate) transform: TransformArgs,
}

#[derive(Clone, Debug, PartialEq, Group)]
pub(crate) struct VerifyArgs {
    /// Folder with a manifest
    #[arg(value_name = "DIR")]
    pub(crate) folder: PathBuf,
}

#[derive(Clone, Debug, PartialEq, Group)]
pub(crate) struct FidelityArgs {
    /// Clip directory
    #[arg(value_name = "CLIP")]
    pub(crate) clip: PathBuf,

    /// Folder to write the table and the scatter pictures to, made when it is missing
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,

    /// Primitives whose single actions are tried, 4 to 100000
    #[arg(long, value_name = "M", default_value_t = 500, value_parser = RangedU64ValueParser::<u32>::new().range(4..=100_000))]
    pub(crate) sample: u32,

    /// Optimise everything for so many steps after the action before the loss is compared, 0 to 1000
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = RangedU64ValueParser::<u32>::new().range(0..=1000))]
    pub(crate) after: u32,

    /// Primitives whose actions are tried with --after, 4 to 100000 [default: as --sample]
    #[arg(long, value_name = "M", value_parser = RangedU64ValueParser::<u32>::new().range(4..=100_000))]
    pub(crate) sample_after: Option<u32>,

    /// Least distance of two actions that are tried with --after in one optimisation, pixels in every view
    #[arg(long, value_name = "PX", default_value_t = 64.0, value_parser = positive)]
    pub(crate) separation: f64,

    /// Optimise the scene for so many steps first, 0 to 10000
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = RangedU64ValueParser::<u32>::new().range(0..=10_000))]
    pub(crate) warm_up: u32,

    #[command(flatten)]
    pub(crate) scene: SceneArgs,

    #[command(flatten)]
    pub(crate) sampling: SamplingArgs,
}

impl SceneArgs {
    /// The number of threads that was asked for.
    pub(crate) fn threads(&self) -> Option<NonZeroUsize> {
        self.threads.and_then(|count| usize::try_from(count).ok()).and_then(NonZeroUsize::new)
    }
}

/// The value of a setting by the word that manifests have for it.
fn word<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    serde_json::from_value(text.into()).map_err(|error| error.to_string())
}

fn number(text: &str, fits: impl Fn(f64) -> bool, expected: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|&value: &f64| value.is_finite() && fits(value));
    value.ok_or_else(|| format!("expected {expected}, found {text:?}"))
}

fn probability(text: &str) -> Result<f64, String> {
    number(text, |value| (0.0..=1.0).contains(&value), "a probability from 0 to 1")
}

fn not_negative(text: &str) -> Result<f64, String> {
    number(text, |value| value >= 0.0, "a number of 0 or more")
}

fn positive(text: &str) -> Result<f64, String> {
    number(text, |value| value > 0.0, "a number above 0")
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    fn parse(line: &str) -> Result<Args, clap::Error> {
        Args::try_parse_from(std::iter::once("lgs-targetgen").chain(line.split(' ')))
    }

    #[test]
    fn the_definition_is_sound_and_every_flag_says_its_default_or_needs_none() {
        Args::command().debug_assert();
        assert_eq!(lgs_cli::flags_without_default(&Args::command()), [""; 0]);
    }

    #[test]
    fn jobs_and_commands_are_told_apart() {
        let job = parse("clips/street more --out o --part 2/4 --signal footprint --zscore per-action").unwrap();
        assert_eq!((job.command, job.job.clips.len()), (None, 2));
        assert_eq!(job.job.part, Some(Part { index: 2, count: 4 }));
        assert_eq!((job.job.signal, job.job.transform.zscore), (Signal::Footprint, ZScore::PerAction));
        assert_eq!((job.job.sampling.rounds, job.job.sampling.rho, job.job.shard_mb), (3, 0.2, 256));
        assert!(matches!(parse("merge a b").unwrap().command, Some(Command::Merge(args)) if args.folders.len() == 2));
        assert!(matches!(parse("retarget a --out b").unwrap().command, Some(Command::Retarget(_))));
        let fidelity = parse("fidelity c --out o --sample 9 --after 3").unwrap().command;
        assert!(matches!(fidelity, Some(Command::Fidelity(args)) if args.after == 3));
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        for line in [
            "c",
            "--out o",
            "c --out o --part 0/3",
            "c --out o --part 4/3",
            "c --out o --part 1",
            "c --out o --rho 1.5",
            "c --out o --rho NaN",
            "c --out o --rounds 0",
            "c --out o --neighbours 0",
            "c --out o --noise-m -1",
            "c --out o --log-scale 0",
            "c --out o --shard-mb 0",
            "c --out o --zscore all",
            "c --out o --image-size 0x10",
            "c --out o --weights random:",
            "merge",
            "fidelity c --out o --sample 1",
        ] {
            assert!(parse(line).is_err(), "{line}");
        }
    }
}
