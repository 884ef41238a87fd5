//! Values of flags and how they are read.

use std::{path::PathBuf, str::FromStr};

use clap::ValueEnum;
use lgs_formats::camera_path::MAX_POSES;

/// Longest time budget that may be asked for, seconds.
const MAX_BUDGET_S: f64 = 1e6;

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

/// `--path`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum PathArg {
    /// Along the input images of a camera.
    BetweenInputs,
    /// As a file says.
    File(PathBuf),
}

impl FromStr for PathArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "" => Err("expected a file or between-inputs".to_owned()),
            "between-inputs" => Ok(Self::BetweenInputs),
            file => Ok(Self::File(file.into())),
        }
    }
}

pub(super) fn pictures(text: &str) -> Result<usize, String> {
    let count = text.parse().ok().filter(|count| (1..=MAX_POSES).contains(count));
    count.ok_or_else(|| format!("expected 1 to {MAX_POSES} pictures, found {text:?}"))
}

pub(super) fn seconds(text: &str) -> Result<f32, String> {
    let value = text.parse().ok().filter(|value: &f32| value.is_finite());
    value.ok_or_else(|| format!("expected a finite number of seconds, found {text:?}"))
}

pub(super) fn budget(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value: &f64| *value > 0.0 && *value <= MAX_BUDGET_S);
    value.ok_or_else(|| format!("expected a time from above 0 to {MAX_BUDGET_S} seconds, found {text:?}"))
}

pub(super) fn rate(text: &str) -> Result<f32, String> {
    let value = text.parse().ok().filter(|value: &f32| *value > 0.0 && *value <= 1000.0);
    value.ok_or_else(|| format!("expected a rate from above 0 to 1000 per second, found {text:?}"))
}
