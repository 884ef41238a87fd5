//! The command line, parsed without side effects.

use std::{num::NonZeroUsize, path::PathBuf};

use clap::{Parser, Subcommand, builder::RangedU64ValueParser};
use lgs_engine::{network::shipped, pipeline::HoldOut};
use lgs_formats::image::ImageSize;
use lgs_measure::clips::Choice;
use lgs_measure::sweep::grid::Axes;

use crate::{
    ablate_args::AblateArgs,
    density_args::DensityArgs,
    grid_args::{GridArgs, also},
    rates_args::RatesArgs,
    scaling_args::ScalingArgs,
    values::{ClipArg, One, WeightsArg, seconds},
};

/// Most timed runs of a configuration, and of rounds before them.
const MOST_REPEATS: u64 = 1000;
/// Largest number of threads that may be asked for.
const MAX_THREADS: u64 = 1024;

/// Measure on clips, and on this machine, what time buys: many configurations of `lgs-infer` and per-scene optimisation, each run
/// several times in turns.
///
/// Writes `report.html`, `points.csv`, `sweep.json`, and what it needs to go on after an interruption: the same command measures what is
/// missing. Every combination of the values that are given is a configuration, as far as it makes sense. With `--scaling`: how cost grows.
#[derive(Clone, Debug, Parser)]
#[command(
    name = "lgs-sweep",
    version,
    max_term_width = 110,
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true
)]
pub(crate) struct Args {
    #[command(subcommand)]
    pub(crate) command: Option<Command>,

    #[command(flatten)]
    pub(crate) sweep: SweepArgs,
}

#[derive(Clone, Debug, Subcommand)]
pub(crate) enum Command {
    /// Measure weights on held-out views: refinement against per-scene optimisation, query, policy, velocities
    Ablate(Box<AblateArgs>),
    /// Search the learning rates of per-scene optimisation, which refinement is compared with
    Rates(Box<RatesArgs>),
    /// Measure which Gaussians scenes need: PSNR against their number, by what decides which of them stay
    Density(Box<DensityArgs>),
}

/// The clips to measure on, and what is tried.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct SweepArgs {
    /// Clip directories, each with options of its own where it needs some
    #[arg(
        value_name = "DIR[;hold-out=RULE][;cameras=A,B][;image-size=HxW][;frames=N]",
        required_unless_present = "scaling"
    )]
    clips: Vec<ClipArg>,

    /// Folder to write to, made when it is missing
    #[arg(long, value_name = "DIR", required = true)]
    pub(crate) out: Option<PathBuf>,

    /// Network weights, separated by commas, each as for lgs-infer; `none`: per-scene optimisation alone
    #[arg(long, value_name = "FILE|tiny|random:FILE.json|none", value_delimiter = ',', default_value = shipped::DEFAULT)]
    pub(crate) weights: Vec<WeightsArg>,

    #[command(flatten)]
    grid: GridArgs,

    /// Another grid beside the first, flags of these kinds in quotes, for combinations that are not wanted with everything; what it does not
    /// say is as usual. May be given more than once [default: none]
    #[arg(long, value_name = "FLAGS", value_parser = also, allow_hyphen_values = true)]
    also: Vec<GridArgs>,

    /// Time budgets to try, seconds: `lgs-infer --time-budget` beside the best of these points that would have been finished in time; with
    /// --weights tiny or none [default: none]
    #[arg(long, value_name = "A,B", value_delimiter = ',', value_parser = seconds)]
    pub(crate) budgets: Vec<f64>,

    /// Frames that are held out, for clips that do not say: as for lgs-infer
    #[arg(long, value_name = "LIST|odd|every:N", default_value = "odd")]
    hold_out: HoldOut,

    /// Size to which every image is brought, for clips that do not say: height x width, pixels [default: each image's own]
    #[arg(long, value_name = "HxW")]
    image_size: Option<ImageSize>,

    /// At most so many frames of clips that do not say, from the first on [default: all]
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<u32>::new().range(1..=1_000_000))]
    frames: Option<u32>,

    /// Weights of LPIPS v0.1 with its squeeze trunk, a safetensors file [default: none, and LPIPS is not measured]
    #[arg(long, value_name = "FILE")]
    pub(crate) lpips_weights: Option<PathBuf>,

    /// Timed runs of each configuration
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = RangedU64ValueParser::<u64>::new().range(1..=MOST_REPEATS))]
    repeats: u64,

    /// Rounds of all configurations before the timed ones
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = RangedU64ValueParser::<u64>::new().range(0..=MOST_REPEATS))]
    warm_up: u64,

    /// Threads to work with, 1 to 1024; figures do not depend on it, times do [default: one per core]
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<u64>::new().range(1..=MAX_THREADS))]
    threads: Option<u64>,

    /// Seed of everything that is drawn at random
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) seed: u64,

    /// What this program starts itself with: the numbers of a clip and of a run to evaluate, for one line of JSON
    #[arg(long, value_name = "CLIP:RUN", hide = true, conflicts_with = "scaling")]
    pub(crate) one: Option<One>,

    #[command(flatten)]
    pub(crate) scaling: ScalingArgs,
}

impl SweepArgs {
    /// The clips, with what all of them share.
    pub(crate) fn clips(&self) -> Vec<Choice> {
        let shared = |clip: &ClipArg| {
            let mut choice = clip.choice.clone();
            if !clip.says_hold_out {
                choice.hold_out = self.hold_out.clone();
            }
            choice.image_size = choice.image_size.or(self.image_size);
            choice.num_frames = choice.num_frames.or(self.frames.map(|count| count as usize));
            choice
        };
        self.clips.iter().map(shared).collect()
    }

    /// What is tried.
    pub(crate) fn axes(&self) -> Vec<Axes> {
        std::iter::once(&self.grid).chain(&self.also).map(GridArgs::axes).collect()
    }

    /// Timed runs of each configuration, and rounds before them.
    pub(crate) fn rounds(&self) -> [usize; 2] {
        [self.repeats, self.warm_up].map(|count| usize::try_from(count).unwrap_or(usize::MAX))
    }

    /// The number of threads that was asked for.
    pub(crate) fn threads(&self) -> Option<NonZeroUsize> {
        self.threads.and_then(|count| usize::try_from(count).ok()).and_then(NonZeroUsize::new)
    }
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroUsize;

    use super::*;
    use clap::CommandFactory;
    use lgs_engine::{
        densify::{Density, Limit},
        gaussians::background::Mode,
        refine::LineSearch,
    };

    fn parse(line: &str) -> Result<SweepArgs, clap::Error> {
        Args::try_parse_from(std::iter::once("lgs-sweep").chain(line.split(' '))).map(|args| args.sweep)
    }

    #[test]
    fn the_definition_is_sound_and_every_flag_says_its_default_or_needs_none() {
        Args::command().debug_assert();
        assert_eq!(lgs_cli::flags_without_default(&Args::command()), [""; 0]);
    }

    #[test]
    fn a_clip_says_more_than_the_flags_for_all() {
        let args = parse("a;hold-out=1;frames=3 b --out o --hold-out every:2 --image-size 48x80 --frames 4").unwrap();
        let clips = args.clips();
        assert_eq!((clips[0].hold_out.to_string(), clips[0].num_frames), ("1".to_owned(), Some(3)));
        assert_eq!((clips[1].hold_out.to_string(), clips[1].num_frames), ("every:2".to_owned(), Some(4)));
        assert!(clips.iter().all(|clip| clip.image_size.is_some()));
    }

    #[test]
    fn commands_need_no_clips_of_a_sweep() {
        let command = |line: &str| Args::try_parse_from(line.split(' ')).map(|args| args.command);
        assert!(matches!(command("lgs-sweep rates --clips a --out o"), Ok(Some(Command::Rates(_)))));
        assert!(matches!(command("lgs-sweep ablate --weights w --scenes a --out o"), Ok(Some(Command::Ablate(_)))));
        assert!(matches!(command("lgs-sweep a --out o"), Ok(None)));
        assert!(command("lgs-sweep a --out o rates --clips a --out o").is_err() && command("lgs-sweep").is_err());
    }

    #[test]
    fn values_are_lists() {
        let line = "a --out o --max-gaussians none,500,70% --refine-views all,2 --adam 5,1 --then-adam 0,4 --pixel-stride 4 --line-search off,last --density random --query off --background none";
        let axes = parse(line).unwrap().axes().remove(0);
        assert_eq!((axes.adam, axes.then_adam, axes.recipes.len()), (vec![5, 1], vec![0, 4], 3 * 3 * 2 * 2));
        let limits: Vec<_> = axes.recipes.iter().step_by(12).map(|recipe| recipe.max_gaussians).collect();
        assert_eq!(limits, [None, Some(Limit::Count(500)), Some(Limit::Percent(70))]);
        let [first, last] = [axes.recipes[0], axes.recipes[35]];
        assert_eq!((first.refine_views, last.refine_views), (None, NonZeroUsize::new(2)));
        assert_eq!((first.line_search, last.line_search), (LineSearch::Off, LineSearch::Last));
        assert_eq!((first.refine_steps, last.refine_steps, last.pixel_stride), (0, 3, "4".parse().unwrap()));
        assert_eq!((first.density, first.query, first.background), (Density::Random, false, Mode::Off));
        assert!(parse("a --out o --no-adam").unwrap().axes()[0].adam.is_empty());
    }

    #[test]
    fn another_grid_has_flags_of_its_own() {
        let line = [
            "lgs-sweep",
            "a",
            "--out",
            "o",
            "--then-adam",
            "7",
            "--also",
            "--background gaps --no-adam",
            "--also",
            "--adam 4",
        ];
        let axes = Args::try_parse_from(line).unwrap().sweep.axes();
        assert_eq!((axes.len(), axes[0].then_adam.clone()), (3, vec![7]));
        assert_eq!((axes[1].recipes[0].background, axes[1].adam.len(), axes[2].adam.clone()), (Mode::Gaps, 0, vec![4]));
        assert_eq!(axes[1].then_adam, axes[2].then_adam, "as usual");
        for wrong in ["--out x", "--refine-steps x", "clip", "--theta 2"] {
            let said = Args::try_parse_from(["lgs-sweep", "a", "--out", "o", "--also", wrong]).unwrap_err().to_string();
            assert!(said.contains("--also"), "{wrong}: {said}");
        }
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        for line in [
            "--out o",
            "a",
            "a;frames=0 --out o",
            "a --out o --refine-steps 1,,2",
            "a --out o --refine-steps 1001",
            "a --out o --query maybe",
            "a --out o --theta 1.5",
            "a --out o --max-gaussians 0",
            "a --out o --adam -1",
            "a --out o --refine-views none",
            "a --out o --pixel-stride 0",
            "a --out o --then-adam 100001",
            "a --out o --repeats 0",
            "a --out o --weights random:",
            "a --out o --one 1",
            "a --out o --budgets 0",
            "a --out o --budgets 1,NaN",
        ] {
            assert!(parse(line).is_err(), "{line}");
        }
    }
}
