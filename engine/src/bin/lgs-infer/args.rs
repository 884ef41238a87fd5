//! The command line, parsed without side effects.

use std::{num::NonZeroUsize, path::PathBuf};

use clap::{Parser, ValueEnum, builder::RangedU64ValueParser};
use lgs_engine::{densify::Density, gaussians::background::Mode, pipeline::HoldOut};
use lgs_formats::image::ImageSize;

/// Largest number of threads that may be asked for.
const MAX_THREADS: u64 = 1024;
/// Largest frame index that may be asked for, so that a range cannot fill the memory.
const MAX_FRAME: usize = 1_000_000;

/// Reconstruct a driving clip as a dynamic 3D Gaussian scene, draw its views and measure them.
///
/// Reads a clip directory (`clip.json`, LiDAR sweeps, images) and writes `scene.ply`, `metrics.json`, pictures of the
/// views under `views/` and `report.html`.
#[derive(Clone, Debug, PartialEq, Parser)]
#[command(name = "lgs-infer", version, max_term_width = 110)]
pub(crate) struct Args {
    /// Clip directory: a folder with a `clip.json` of format lgs-clip/1, or a folder that `lgs-clip import` knows
    #[arg(value_name = "CLIP_DIR", required_unless_present = "describe")]
    pub(crate) clip_dir: Option<PathBuf>,

    /// Print the model of a config or of a weights file as a table and do nothing else [default: none]
    #[arg(long, value_name = "FILE", conflicts_with = "clip_dir")]
    pub(crate) describe: Option<PathBuf>,

    /// Folder to write to, made when it is missing [default: out/<name of the clip>]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,

    /// Network weights, a safetensors file; `random:FILE.json`: weights of a model config drawn from --seed, for size and
    /// speed work; `none`: the scene is what the sweeps and the images say by themselves
    #[arg(long, value_name = "FILE|random:FILE.json|none", default_value = "none", value_parser = weights)]
    pub(crate) weights: Weights,

    /// Steps of the learned refinement over the input views, 0 to 1000
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = RangedU64ValueParser::<u32>::new().range(0..=1000))]
    pub(crate) refine_steps: u32,

    /// Who prunes and adds primitives: `policy`: the network; `random`: chance, as often as the network would; `off`: nobody
    #[arg(long, value_enum, default_value_t = DensityArg::Policy)]
    pub(crate) density: DensityArg,

    /// Score above which a primitive is pruned, 0 to 1
    #[arg(long, value_name = "F", default_value_t = 0.7, value_parser = score)]
    pub(crate) theta_prune: f32,

    /// Score above which a primitive gets a copy beside it, 0 to 1
    #[arg(long, value_name = "F", default_value_t = 0.7, value_parser = score)]
    pub(crate) theta_add: f32,

    /// Largest number of LiDAR Gaussians after pruning and adding: the worst go first, then the best copies come
    /// [default: as many as the scores ask for]
    #[arg(long, value_name = "N")]
    pub(crate) max_gaussians: Option<usize>,

    /// Whether primitives ask their nearest of other timestamps
    #[arg(long, value_enum, default_value_t = Switch::On)]
    pub(crate) query: Switch,

    /// Names of the cameras to use, separated by commas [default: all]
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    pub(crate) cameras: Option<Vec<String>>,

    /// Size to which every image is brought: height x width, pixels [default: each image's own]
    #[arg(long, value_name = "HxW")]
    pub(crate) image_size: Option<ImageSize>,

    /// Frames to use: indices of the clip from 0 on and ranges with both ends, such as 0,2,5..8 [default: all]
    #[arg(long, value_name = "LIST", value_parser = frame_list)]
    pub(crate) frames: Option<FrameList>,

    /// Frames whose images and sweeps only the figures may see: a list as for --frames; `odd`: indices 1, 3, 5, ...;
    /// `every:N`: the N-th frame of the clip, the 2N-th and so on, which are the indices N-1, 2N-1, ... [default: none]
    #[arg(long, value_name = "LIST|odd|every:N", value_parser = hold_out)]
    pub(crate) hold_out: Option<HoldOut>,

    /// Gaussians for what the LiDAR does not reach: `auto`: what the clip needs; `off`: none; `sky`: a far hemisphere;
    /// `depth`: where the surfaces around a gap continue to
    #[arg(long, value_enum, default_value_t = BackgroundArg::Auto)]
    pub(crate) background: BackgroundArg,

    /// Views to draw, measure and write: `all`, `held-out` or `none`
    #[arg(long, value_enum, default_value_t = ViewsArg::All)]
    pub(crate) views: ViewsArg,

    /// Draw every view at this moment, seconds since the first input sweep, instead of at its image's own; there is no
    /// truth to measure against then [default: each image's own]
    #[arg(long, value_name = "S", value_parser = seconds, allow_negative_numbers = true)]
    pub(crate) at_time: Option<f32>,

    /// Weights of LPIPS v0.1 with its squeeze trunk, a safetensors file [default: none, and LPIPS is not measured]
    #[arg(long, value_name = "FILE")]
    pub(crate) lpips_weights: Option<PathBuf>,

    /// Threads to work with, 1 to 1024; the result does not depend on it [default: one per core]
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<u64>::new().range(1..=MAX_THREADS))]
    threads: Option<u64>,

    /// Seed of everything that is drawn at random, recorded in metrics.json
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) seed: u64,

    /// Print the content of metrics.json to standard output instead of a summary
    #[arg(long)]
    pub(crate) json: bool,
}

impl Args {
    /// The number of threads that was asked for.
    pub(crate) fn threads(&self) -> Option<NonZeroUsize> {
        self.threads.and_then(|count| usize::try_from(count).ok()).and_then(NonZeroUsize::new)
    }
}

/// Where the network's weights come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Weights {
    /// There is no network.
    None,
    /// A weights file.
    File(PathBuf),
    /// Drawn from the seed, in the sizes of a config file.
    Random(PathBuf),
}

/// `--density`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum DensityArg {
    Policy,
    Random,
    Off,
}

impl DensityArg {
    /// The engine's word for it.
    pub(crate) const fn density(self) -> Density {
        match self {
            Self::Policy => Density::Policy,
            Self::Random => Density::Random,
            Self::Off => Density::Off,
        }
    }
}

/// `on` or `off`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Switch {
    On,
    Off,
}

/// Indices of frames, in the order in which they were given.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct FrameList(pub(crate) Vec<usize>);

/// `--background`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum BackgroundArg {
    Auto,
    Off,
    Sky,
    Depth,
}

impl BackgroundArg {
    /// The engine's word for it.
    pub(crate) const fn mode(self) -> Mode {
        match self {
            Self::Auto => Mode::Auto,
            Self::Off => Mode::Off,
            Self::Sky => Mode::Sky,
            Self::Depth => Mode::Depth,
        }
    }
}

/// `--views`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ViewsArg {
    All,
    HeldOut,
    None,
}

/// The word that the user gives for a value.
pub(crate) fn word(value: &impl ValueEnum) -> String {
    value.to_possible_value().map_or(String::new(), |value| value.get_name().to_owned())
}

fn weights(text: &str) -> Result<Weights, String> {
    match (text, text.strip_prefix("random:")) {
        ("none", _) => Ok(Weights::None),
        ("", _) | (_, Some("")) => Err("expected none, a file, or random: and a file".to_owned()),
        (_, Some(config)) => Ok(Weights::Random(config.into())),
        (file, None) => Ok(Weights::File(file.into())),
    }
}

fn frame_list(text: &str) -> Result<FrameList, String> {
    let mut frames = Vec::new();
    for item in text.split(',') {
        let (first, last) = item.split_once("..").unwrap_or((item, item));
        let (first, last) = (index(first)?, index(last)?);
        if first > last {
            return Err(format!("expected an ascending range, found {item}"));
        }
        frames.extend(first..=last);
    }
    Ok(FrameList(frames))
}

fn index(text: &str) -> Result<usize, String> {
    let number = text.trim().parse().ok().filter(|&number| number <= MAX_FRAME);
    number.ok_or_else(|| format!("expected frame indices from 0 to {MAX_FRAME}, found {text:?}"))
}

fn hold_out(text: &str) -> Result<HoldOut, String> {
    match text.split_once(':') {
        Some(("every", n)) => {
            n.parse().map(HoldOut::Every).map_err(|error| format!("expected every:N with N of 1 or more: {error}"))
        }
        _ if text == "odd" => Ok(HoldOut::Odd),
        _ => frame_list(text).map(|list| HoldOut::List(list.0)).map_err(|error| format!("{error}; or odd, or every:N")),
    }
}

fn score(text: &str) -> Result<f32, String> {
    let value = text.parse().ok().filter(|value: &f32| (0.0..=1.0).contains(value));
    value.ok_or_else(|| format!("expected a score from 0 to 1, found {text:?}"))
}

fn seconds(text: &str) -> Result<f32, String> {
    let value = text.parse().ok().filter(|value: &f32| value.is_finite());
    value.ok_or_else(|| format!("expected a finite number of seconds, found {text:?}"))
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    fn parse(line: &str) -> Result<Args, clap::Error> {
        Args::try_parse_from(std::iter::once("lgs-infer").chain(line.split(' ')))
    }

    #[test]
    fn the_definition_is_sound_and_every_flag_says_its_default_or_needs_none() {
        let command = Args::command();
        command.clone().debug_assert();
        for flag in command.get_arguments().filter(|flag| flag.get_long().is_some_and(|name| name != "json")) {
            let help = flag.get_help().map_or(String::new(), ToString::to_string);
            let said = help.contains("[default: ") || !flag.get_default_values().is_empty();
            assert!(said, "--{} says no default: {help}", flag.get_id());
        }
    }

    #[test]
    fn defaults_are_as_the_help_says() {
        let args = parse("clip").unwrap();
        assert_eq!((args.out, args.cameras, args.frames, args.hold_out), (None, None, None, None));
        assert_eq!((args.background, args.views, args.weights), (BackgroundArg::Auto, ViewsArg::All, Weights::None));
        assert_eq!((args.threads, args.seed, args.json), (None, 0, false));
    }

    #[test]
    fn weights_are_a_file_a_config_or_none() {
        let of = |line: &str| parse(line).unwrap().weights;
        assert_eq!(of("c --weights tiny.safetensors"), Weights::File("tiny.safetensors".into()));
        assert_eq!(of("c --weights random:full.json"), Weights::Random("full.json".into()));
        assert_eq!(parse("--describe full.json").unwrap().describe, Some("full.json".into()));
    }

    #[test]
    fn lists_and_rules_are_read() {
        let args =
            parse("c --frames 0,2,5..8 --hold-out 2,6 --cameras A,B --image-size 304x484 --at-time -0.5").unwrap();
        assert_eq!(args.frames, Some(FrameList(vec![0, 2, 5, 6, 7, 8])));
        assert_eq!(args.hold_out, Some(HoldOut::List(vec![2, 6])));
        assert_eq!(args.cameras, Some(vec!["A".to_owned(), "B".to_owned()]));
        assert_eq!(args.image_size.map(|size| [size.height, size.width]), Some([304, 484]));
        assert_eq!(args.at_time, Some(-0.5));
        assert_eq!(parse("c --hold-out odd").unwrap().hold_out, Some(HoldOut::Odd));
        let every = parse("c --hold-out every:10 --threads 3 --views held-out").unwrap();
        assert_eq!(every.hold_out, Some(HoldOut::Every(NonZeroUsize::new(10).unwrap())));
        assert_eq!((every.threads().map(NonZeroUsize::get), every.views), (Some(3), ViewsArg::HeldOut));
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        for line in [
            "c --frames 5..2",
            "c --frames -1",
            "c --frames 0..99999999999",
            "c --frames 1,,2",
            "c --hold-out every:0",
            "c --hold-out even",
            "c --at-time inf",
            "c --at-time NaN",
            "c --threads 0",
            "c --threads 5000",
            "c --image-size 304",
            "c --image-size 0x10",
            "c --weights random:",
            "c --refine-steps -1",
            "c --query maybe",
            "c --theta-add 1.5",
            "c --theta-prune NaN",
            "c --describe models/tiny.json",
            "--json",
            "c --seed -1",
            "c --unknown 1",
            "c another",
        ] {
            assert!(parse(line).is_err(), "{line}");
        }
    }
}
