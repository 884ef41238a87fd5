//! Values of flags and how they are read.

use std::str::FromStr;

use lgs_engine::network::source::ModelSource;
use lgs_measure::clips::Choice;

/// A clip and its own options.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ClipArg {
    pub(crate) choice: Choice,
    /// Whether it says which of its frames are held out.
    pub(crate) says_hold_out: bool,
}

impl FromStr for ClipArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Ok(Self { choice: text.parse()?, says_hold_out: text.contains(";hold-out=") })
    }
}

/// Weights, and how the user names them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct WeightsArg {
    pub(crate) text: String,
    pub(crate) source: ModelSource,
}

impl WeightsArg {
    /// A name for people: that of the file, without what all such files have.
    pub(crate) fn name(&self) -> String {
        let file = self.text.rsplit(['/', '\\']).next().unwrap_or(&self.text);
        let stem = file.trim_end_matches(".safetensors").trim_end_matches(".json");
        if matches!(self.source, ModelSource::Random(_)) { format!("random {stem}") } else { stem.to_owned() }
    }
}

impl FromStr for WeightsArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Ok(Self { source: text.parse()?, text: text.to_owned() })
    }
}

/// Numbers of a clip and of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct One {
    pub(crate) clip: usize,
    pub(crate) run: usize,
}

impl FromStr for One {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once(':').and_then(|(clip, run)| Some((clip.parse().ok()?, run.parse().ok()?)));
        numbers.map(|(clip, run)| Self { clip, run }).ok_or_else(|| format!("expected CLIP:RUN, found {text:?}"))
    }
}

pub(crate) fn steps<const MOST: usize>(text: &str) -> Result<usize, String> {
    let value = text.parse().ok().filter(|steps| *steps <= MOST);
    value.ok_or_else(|| format!("expected a number from 0 to {MOST}, found {text:?}"))
}

pub(crate) fn seconds(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value: &f64| *value > 0.0 && value.is_finite());
    value.ok_or_else(|| format!("expected a number of seconds above 0, found {text:?}"))
}
