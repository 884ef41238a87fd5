//! The search for the learning rates of per-scene optimisation: one group of attributes after the other, on clips that nothing else is
//! measured on.

use std::path::Path;

use lgs_engine::{
    gaussians::GaussianSet,
    refine::adam::{Adam, AdamRates, AdamSettings, RateGroup},
    views::View,
};
use lgs_formats::{error::FormatError, write::write_atomic};
use serde::{Deserialize, Serialize};

use super::subject::Subject;
use crate::error::{Result, TrainError};

/// Name of the file that records the search.
pub const SEARCH_FILE: &str = "rates.json";

/// How rates are searched for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SearchSettings {
    /// Numbers of steps after which a scene is measured, ascending; a trial's score is the mean PSNR over them.
    pub marks: Vec<usize>,
    /// Factors by which a rate is changed, one round over all groups for each.
    pub factors: Vec<f64>,
    /// Where the search begins.
    pub begin: AdamRates,
    /// What the scenes are: names, views, sizes, and whether a network has predicted them.
    pub scenes: Vec<String>,
}

/// One setting of the rates that was tried.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trial {
    /// The rates.
    pub rates: AdamRates,
    /// Mean PSNR over the scenes after each number of steps, decibels.
    pub psnr: Vec<f64>,
    /// Their mean.
    pub score: f64,
}

/// A search as it is recorded: it goes on where it ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Search {
    /// How it searches.
    pub settings: SearchSettings,
    /// The best rates so far.
    pub best: AdamRates,
    /// Everything that was tried, in order.
    pub trials: Vec<Trial>,
}

/// A scene to be optimised.
#[derive(Debug)]
pub struct Start<'a> {
    /// Its clip.
    pub subject: &'a Subject<'a>,
    /// Where the optimisation begins.
    pub scene: GaussianSet,
}

impl Search {
    /// The search that `dir` records, or a new one.
    ///
    /// # Errors
    /// A file that cannot be read, or that records a search of other settings.
    pub fn open(dir: &Path, settings: SearchSettings) -> Result<Self> {
        let file = dir.join(SEARCH_FILE);
        let text = match std::fs::read_to_string(&file) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                return Ok(Self { best: settings.begin, settings, trials: Vec::new() });
            }
            Err(error) => return Err(FormatError::io(&file, "read", error).into()),
        };
        let found: Self = serde_json::from_str(&text)
            .map_err(|e| FormatError::invalid(&file, "content", "a recorded search", e.to_string()))?;
        if found.settings == settings {
            return Ok(found);
        }
        Err(TrainError::config(file.display().to_string(), "a search of the same settings", "other settings"))
    }

    /// The best rates: every group's rate is raised, else lowered, by a factor as long as that helps; `told` hears of every trial.
    ///
    /// # Errors
    /// When a scene cannot be measured, or the record not be written.
    pub fn run(&mut self, starts: &[Start<'_>], dir: &Path, mut told: impl FnMut(&Trial)) -> Result<AdamRates> {
        let file = dir.join(SEARCH_FILE);
        let (mut best, mut score) = (self.settings.begin, 0.0);
        let mut known = 0;
        let mut attempt = |search: &mut Self, rates: AdamRates| -> Result<f64> {
            if let Some(trial) = search.trials.get(known).filter(|trial| trial.rates == rates) {
                known += 1;
                return Ok(trial.score);
            }
            search.trials.truncate(known);
            let trial = trial(starts, rates, &search.settings.marks)?;
            told(&trial);
            search.trials.push(trial.clone());
            known += 1;
            search.write(&file)?;
            Ok(trial.score)
        };
        for (round, factor) in self.settings.factors.clone().into_iter().enumerate() {
            if round == 0 {
                score = attempt(self, best)?;
            }
            for group in RateGroup::ALL {
                for direction in [factor, 1.0 / factor] {
                    let mut moved = false;
                    loop {
                        let mut rates = best;
                        *rates.of(group) *= direction;
                        let found = attempt(self, rates)?;
                        if found <= score {
                            break;
                        }
                        (best, score, moved) = (rates, found, true);
                    }
                    if moved {
                        break;
                    }
                }
            }
        }
        self.best = best;
        self.write(&file)?;
        Ok(best)
    }

    fn write(&self, file: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self)
            .map_err(|e| TrainError::config(SEARCH_FILE, "figures that JSON can hold", e))?;
        Ok(write_atomic(file, text.as_bytes())?)
    }
}

/// What some rates are worth.
fn trial(starts: &[Start<'_>], rates: AdamRates, marks: &[usize]) -> Result<Trial> {
    let mut psnr = vec![0.0; marks.len()];
    for start in starts {
        let mut scene = start.scene.clone();
        let views: Vec<&View> = start.subject.views();
        let mut adam = Adam::new(scene.len(), AdamSettings { rates, ..AdamSettings::default() });
        let mut done = 0;
        for (sum, &mark) in psnr.iter_mut().zip(marks) {
            while done < mark {
                adam.step(&mut scene, &views);
                done += 1;
            }
            *sum += start.subject.figures(&scene)?.psnr.unwrap_or(0.0) / starts.len() as f64;
        }
    }
    let score = psnr.iter().sum::<f64>() / marks.len().max(1) as f64;
    Ok(Trial { rates, psnr, score })
}
