//! `models/presets.json`: recipes, what they were worth and what they took on some clips, and the names of three of them.

use serde::{Deserialize, Serialize};

use super::{fit, work::ClipWork};
use crate::{
    error::{EngineError, Result},
    recipe::Recipe,
    words::Words,
};

/// The value of `format`.
pub const PRESETS_FORMAT: &str = "lgs-presets/1";
/// The file in the repository, as it was when the program was built.
const SHIPPED: &str = include_str!("../../../models/presets.json");

/// A clip that was measured on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedClip {
    /// Its name.
    pub name: String,
    /// How much there was to do.
    pub work: ClipWork,
    /// Seconds of its initial `LiDAR` Gaussians, which every recipe begins with: they tell how fast a machine is.
    pub begin_s: f64,
}

/// A recipe and its figures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeasuredRecipe {
    /// The recipe.
    pub recipe: Recipe,
    /// Of each clip, mean PSNR over the held-out views, dB.
    pub psnr: Vec<f64>,
    /// Of each clip, seconds of the reconstruction, the median.
    pub seconds: Vec<f64>,
}

/// A recipe with a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Named {
    /// The best of those that are at least 3.5 times as fast as `accurate`.
    Fast,
    /// The best of those that take at most half the time of `accurate`.
    Balanced,
    /// The best.
    Accurate,
}

impl Words for Named {
    const WORDS: &[(&str, Self, &str)] = &[
        ("fast", Self::Fast, "The best of those that are at least 3.5 times as fast as accurate"),
        ("balanced", Self::Balanced, "The best of those that take at most half the time of accurate"),
        ("accurate", Self::Accurate, "The best"),
    ];
}

/// Which recipe a name means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Preset {
    /// The name.
    pub name: Named,
    /// Index of the recipe.
    pub recipe: usize,
}

/// The page.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// [`PRESETS_FORMAT`].
    pub format: String,
    /// SHA-256 of the weights.
    pub weights: String,
    /// What measured: processor and threads.
    pub machine: String,
    /// The names.
    pub presets: Vec<Preset>,
    /// The clips.
    pub clips: Vec<RecordedClip>,
    /// The recipes.
    pub recipes: Vec<MeasuredRecipe>,
}

impl Record {
    /// The one that ships.
    ///
    /// # Errors
    /// When the repository held one that is none.
    pub fn shipped() -> Result<Self> {
        Self::parse(SHIPPED)
    }

    /// A page as text.
    ///
    /// # Errors
    /// One line that says what is wrong with it.
    pub fn parse(text: &str) -> Result<Self> {
        let wrong = |expected: String, found: String| EngineError::Setting { setting: "presets.json", expected, found };
        let record: Self =
            serde_json::from_str(text).map_err(|error| wrong("a page of presets".to_owned(), error.to_string()))?;
        if record.format != PRESETS_FORMAT {
            return Err(wrong(PRESETS_FORMAT.to_owned(), record.format));
        }
        let of_every_clip = |row: &MeasuredRecipe| [row.psnr.len(), row.seconds.len()] == [record.clips.len(); 2];
        if record.clips.is_empty() || !record.recipes.iter().all(of_every_clip) {
            return Err(wrong("figures of every recipe on every clip".to_owned(), "others".to_owned()));
        }
        match record.presets.iter().find(|preset| preset.recipe >= record.recipes.len()) {
            Some(preset) => Err(wrong(format!("one of {} recipes", record.recipes.len()), preset.recipe.to_string())),
            None => Ok(record),
        }
    }

    /// The recipe of a name; the paper's where nothing was measured.
    pub fn preset(&self, name: Named) -> Recipe {
        let preset = self.presets.iter().find(|preset| preset.name == name);
        preset.and_then(|preset| self.recipes.get(preset.recipe)).map_or_else(Recipe::default, |row| row.recipe)
    }

    /// Seconds that the initial Gaussians of a clip would take on the machine that measured.
    pub(super) fn begin_s(&self, work: &ClipWork) -> f64 {
        let samples: Vec<_> = self.clips.iter().map(|clip| (clip.work, clip.begin_s)).collect();
        fit::seconds(&samples, work)
    }

    /// Seconds that a recipe would take on a clip, on the machine that measured.
    pub(super) fn seconds(&self, row: &MeasuredRecipe, work: &ClipWork) -> f64 {
        fit::seconds(&self.of_clips(row.seconds.iter().copied()), work)
    }

    /// Decibels that a recipe stays behind the best one, on clips like this one.
    pub(super) fn behind(&self, row: &MeasuredRecipe, work: &ClipWork) -> f64 {
        let best = |clip: usize| self.recipes.iter().map(|row| row.psnr[clip]).fold(f64::NEG_INFINITY, f64::max);
        let behind = row.psnr.iter().enumerate().map(|(clip, psnr)| best(clip) - psnr);
        fit::alike(&self.of_clips(behind), work)
    }

    fn of_clips(&self, values: impl Iterator<Item = f64>) -> Vec<(ClipWork, f64)> {
        self.clips.iter().map(|clip| clip.work).zip(values).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_ships_can_be_read_and_names_three() {
        let record = Record::shipped().unwrap();
        let named: Vec<Named> = record.presets.iter().map(|preset| preset.name).collect();
        assert_eq!(named, [Named::Fast, Named::Balanced, Named::Accurate]);
    }

    #[test]
    fn a_damaged_page_is_refused_in_one_line() {
        let good = Record::shipped().unwrap();
        let text = |record: &Record| serde_json::to_string(record).unwrap();
        assert_eq!(Record::parse(&text(&good)).unwrap(), good);
        let mut short = good.clone();
        short.recipes[0].psnr.pop();
        let mut beyond = good.clone();
        beyond.presets[0].recipe = 1_000_000;
        let other = Record { format: "lgs-presets/9".to_owned(), ..good.clone() };
        let pages = [text(&short), text(&beyond), text(&other), "{}".to_owned(), text(&good).replace("points", "x")];
        for page in pages {
            let message = Record::parse(&page).unwrap_err().to_string();
            assert!(message.starts_with("presets.json: expected") && !message.contains('\n'), "{message}");
        }
    }
}
