//! Values of flags and how they are read.

use std::path::PathBuf;

use clap::ValueEnum;
use lgs_engine::{densify::Density, gaussians::background::Mode, pipeline::HoldOut};

/// Largest frame index that may be asked for, so that a range cannot fill the memory.
const MAX_FRAME: usize = 1_000_000;

/// Most steps of per-scene optimisation that may be asked for.
const MAX_ADAM_STEPS: usize = 100_000;

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

/// `--refine-with`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RefineWith {
    /// The network.
    Learned,
    /// So many steps of per-scene optimisation.
    Adam(usize),
}

impl RefineWith {
    /// As the user gives it.
    pub(crate) fn word(self) -> String {
        match self {
            Self::Learned => "learned".to_owned(),
            Self::Adam(steps) => format!("adam:{steps}"),
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

pub(super) fn weights(text: &str) -> Result<Weights, String> {
    match (text, text.strip_prefix("random:")) {
        ("none", _) => Ok(Weights::None),
        ("", _) | (_, Some("")) => Err("expected none, a file, or random: and a file".to_owned()),
        (_, Some(config)) => Ok(Weights::Random(config.into())),
        (file, None) => Ok(Weights::File(file.into())),
    }
}

pub(super) fn frame_list(text: &str) -> Result<FrameList, String> {
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

pub(super) fn hold_out(text: &str) -> Result<HoldOut, String> {
    match text.split_once(':') {
        Some(("every", n)) => {
            n.parse().map(HoldOut::Every).map_err(|error| format!("expected every:N with N of 1 or more: {error}"))
        }
        _ if text == "odd" => Ok(HoldOut::Odd),
        _ => frame_list(text).map(|list| HoldOut::List(list.0)).map_err(|error| format!("{error}; or odd, or every:N")),
    }
}

pub(super) fn refine_with(text: &str) -> Result<RefineWith, String> {
    let steps = |count: &str| count.parse().ok().filter(|&steps| steps <= MAX_ADAM_STEPS);
    match text.split_once(':') {
        None if text == "learned" => Ok(RefineWith::Learned),
        Some(("adam", count)) => {
            let wrong = || format!("expected adam:N with N from 0 to {MAX_ADAM_STEPS}, found {text:?}");
            steps(count).map(RefineWith::Adam).ok_or_else(wrong)
        }
        _ => Err("expected learned or adam:N".to_owned()),
    }
}

pub(super) fn score(text: &str) -> Result<f32, String> {
    let value = text.parse().ok().filter(|value: &f32| (0.0..=1.0).contains(value));
    value.ok_or_else(|| format!("expected a score from 0 to 1, found {text:?}"))
}

pub(super) fn seconds(text: &str) -> Result<f32, String> {
    let value = text.parse().ok().filter(|value: &f32| value.is_finite());
    value.ok_or_else(|| format!("expected a finite number of seconds, found {text:?}"))
}
