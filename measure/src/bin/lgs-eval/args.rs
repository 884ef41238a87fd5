//! The command line, parsed and checked without side effects.

use std::{num::NonZeroUsize, path::PathBuf};

use clap::{Args as Group, Parser, Subcommand, builder::RangedU64ValueParser};
use lgs_cli::words;
use lgs_engine::{
    network::{shipped, source::ModelSource},
    pipeline::HoldOut,
    plan::Named,
    words::Words,
};
use lgs_formats::{image::ImageSize, jobs::Part};
use lgs_measure::evaluate::protocol::Name;

use crate::recipe::RecipeArgs;

/// Largest number of threads that may be asked for.
const MAX_THREADS: u64 = 1024;
/// Largest number of frames or snippets that may be asked for.
const MAX_FRAMES: u64 = 1_000_000;

const PROTOCOLS: &[(&str, Name, &str)] = &[
    (
        "waymo",
        Name::Waymo,
        "Three front cameras at 256x512; every tenth frame is drawn from the three nearest of the others",
    ),
    (
        "pandaset",
        Name::PandaSet,
        "Front camera at full size; snippets of 11 frames, four a log, the odd frames held out",
    ),
    ("own", Name::Own, "Snippets as the flags say"),
];

/// Evaluate whole drives by a protocol: cut them into snippets, reconstruct each, measure the frames that were held out.
///
/// Writes `evaluation.json`, `views.csv`, `snippets.csv`, `times.csv`, `report.html` and what it keeps of each snippet. A snippet that fails is
/// listed and skipped; the job then ends with exit code 1. After an interruption the same command with --resume goes on.
#[derive(Clone, Debug, Parser)]
#[command(name = "lgs-eval", version, max_term_width = 110, args_conflicts_with_subcommands = true)]
#[command(subcommand_negates_reqs = true)]
pub(crate) struct Args {
    #[command(subcommand)]
    pub(crate) command: Option<Command>,

    #[command(flatten)]
    pub(crate) job: JobArgs,
}

#[derive(Clone, Debug, Subcommand)]
pub(crate) enum Command {
    /// Join the parts of a job, and write the figures of the whole
    Merge(MergeArgs),
}

/// The drives, and how they are evaluated.
#[derive(Clone, Debug, Group)]
pub(crate) struct JobArgs {
    /// Drives: clip directories or folders and files that `lgs-clip import` knows; folders of drives; list files with one drive a line
    #[arg(value_name = "DRIVES", required = true)]
    pub(crate) drives: Vec<PathBuf>,

    /// How drives are cut and measured
    #[arg(long, required = true, value_parser = words(PROTOCOLS))]
    pub(crate) protocol: Option<Name>,

    /// Folder to write to, made when it is missing
    #[arg(long, value_name = "DIR", required = true)]
    pub(crate) out: Option<PathBuf>,

    /// Drives to take of a folder of drives: their names, separated by commas, or `all` [default: with pandaset the ten test logs, by the number
    /// that their names end in; else all]
    #[arg(long, value_name = "A,B|all", value_delimiter = ',')]
    pub(crate) logs: Option<Vec<String>>,

    /// Names of the cameras, separated by commas [default: with waymo the three front cameras, with
    /// pandaset `front_camera`, with own all]
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    pub(crate) cameras: Option<Vec<String>>,

    #[command(flatten)]
    pub(crate) own: OwnArgs,

    /// Network weights, as for lgs-infer
    #[arg(long, value_name = "FILE|tiny|random:FILE.json|none", default_value = shipped::DEFAULT)]
    pub(crate) weights: ModelSource,

    /// A point on the measured front of speed and accuracy, which the flags given beside it change [default: what each flag says]
    #[arg(long, value_parser = words(Named::WORDS))]
    pub(crate) preset: Option<Named>,

    /// Evaluate the three presets, each on every snippet
    #[arg(long, conflicts_with = "preset")]
    pub(crate) sweep_presets: bool,

    #[command(flatten)]
    pub(crate) recipe: RecipeArgs,

    /// Weights of LPIPS v0.1 with its squeeze trunk, a safetensors file [default: none, and LPIPS is not measured]
    #[arg(long, value_name = "FILE")]
    pub(crate) lpips_weights: Option<PathBuf>,

    /// Keep the scene of every snippet: `items/<snippet>/scene.ply`
    #[arg(long)]
    pub(crate) scenes: bool,

    /// Write a page for each log, `play-<log>.html`, that plays the scenes of its snippets one after the other
    #[arg(long)]
    pub(crate) viewer: bool,

    /// Do the I-th of N equal shares of the snippets [default: the share that a Slurm array task or a Kubernetes indexed job is told by
    /// its environment, else all snippets]
    #[arg(long, value_name = "I/N")]
    pub(crate) part: Option<Part>,

    /// Go on where an earlier run of the same job into the same folder ended
    #[arg(long)]
    pub(crate) resume: bool,

    /// Threads to work with, 1 to 1024; figures do not depend on it [default: one per core]
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<u64>::new().range(1..=MAX_THREADS))]
    threads: Option<u64>,

    /// Seed of everything that is drawn at random
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) seed: u64,

    /// Print figures and times as JSON instead of a table
    #[arg(long)]
    pub(crate) json: bool,
}

/// What only `own` leaves to flags.
#[derive(Clone, Debug, Group)]
pub(crate) struct OwnArgs {
    /// With own: size to which every image is brought: height x width, pixels [default: each image's own]
    #[arg(long, value_name = "HxW")]
    pub(crate) image_size: Option<ImageSize>,

    /// With own: frames of a snippet, 2 to 1000000 [default: 11]
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<u64>::new().range(2..=MAX_FRAMES))]
    snippet_frames: Option<u64>,

    /// With own: frames from the start of a snippet to that of the next [default: as --snippet-frames]
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<u64>::new().range(1..=MAX_FRAMES))]
    stride: Option<u64>,

    /// With own: frames of a snippet, counted in it from 0 on, that are held out and measured; the others are inputs: a list such as 1,3..5;
    /// `odd`; `every:N`: the N-th, the 2N-th and so on; `none`: scenes without figures [default: odd]
    #[arg(long, value_name = "LIST|odd|every:N|none")]
    pub(crate) hold_out: Option<HoldOut>,

    /// With own: most snippets of a drive, from its beginning [default: all]
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<u64>::new().range(1..=MAX_FRAMES))]
    max_snippets: Option<u64>,
}

#[derive(Clone, Debug, Group)]
pub(crate) struct MergeArgs {
    /// Folders that the parts wrote to
    #[arg(value_name = "DIRS", required = true)]
    pub(crate) folders: Vec<PathBuf>,

    /// Folder of the whole job [default: the first of DIRS]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,

    /// Print figures and times as JSON instead of a table
    #[arg(long)]
    pub(crate) json: bool,
}

fn size(number: u64) -> usize {
    usize::try_from(number).unwrap_or(usize::MAX)
}

impl JobArgs {
    /// The number of threads that was asked for.
    pub(crate) fn threads(&self) -> Option<NonZeroUsize> {
        self.threads.and_then(|count| NonZeroUsize::new(size(count)))
    }
}

impl OwnArgs {
    /// The first flag that was given.
    pub(crate) fn first(&self) -> Option<&'static str> {
        let given = [
            ("image-size", self.image_size.is_some()),
            ("snippet-frames", self.snippet_frames.is_some()),
            ("stride", self.stride.is_some()),
            ("hold-out", self.hold_out.is_some()),
            ("max-snippets", self.max_snippets.is_some()),
        ];
        given.into_iter().find(|(_, given)| *given).map(|(name, _)| name)
    }

    /// Frames of a snippet.
    pub(crate) fn length(&self) -> usize {
        size(self.snippet_frames.unwrap_or(11))
    }

    /// Frames from the start of a snippet to that of the next.
    pub(crate) fn stride(&self) -> usize {
        self.stride.map_or_else(|| self.length(), size)
    }

    /// Most snippets of a drive.
    pub(crate) fn most(&self) -> Option<usize> {
        self.max_snippets.map(size)
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    fn parse(line: &str) -> Result<Args, clap::Error> {
        Args::try_parse_from(std::iter::once("lgs-eval").chain(line.split(' ')))
    }

    #[test]
    fn the_definition_is_sound_and_every_flag_says_its_default_or_needs_none() {
        Args::command().debug_assert();
        assert_eq!(lgs_cli::flags_without_default(&Args::command()), [""; 0]);
    }

    #[test]
    fn jobs_and_merges_are_told_apart() {
        let args =
            parse("a b --protocol own --out o --part 2/4 --snippet-frames 3 --stride 1 --refine-steps 2").unwrap();
        let job = args.job;
        assert_eq!((job.drives.len(), job.protocol, job.part), (2, Some(Name::Own), Some(Part { index: 2, count: 4 })));
        assert_eq!((job.own.length(), job.own.stride(), job.own.first()), (3, 1, Some("snippet-frames")));
        assert!(job.recipe.value("refine-steps") == Some("2") && job.recipe.first() == Some("refine-steps"));
        let plain = parse("a --protocol waymo --out o").unwrap().job;
        assert_eq!((plain.own.first(), plain.own.length(), plain.own.stride()), (None, 11, 11));
        assert!(matches!(parse("merge a b").unwrap().command, Some(Command::Merge(args)) if args.folders.len() == 2));
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        for line in [
            "a --out o",
            "a --protocol own",
            "--protocol own --out o",
            "a --protocol kitti --out o",
            "a --protocol own --out o --part 0/3",
            "a --protocol own --out o --snippet-frames 1",
            "a --protocol own --out o --stride 0",
            "a --protocol own --out o --hold-out even",
            "a --protocol own --out o --max-snippets 0",
            "a --protocol own --out o --preset fast --sweep-presets",
            "merge",
        ] {
            assert!(parse(line).is_err(), "{line}");
        }
    }
}
