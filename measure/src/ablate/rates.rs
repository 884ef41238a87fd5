//! The search for the learning rates of per-scene optimisation: one group of attributes after the other, on clips that nothing else is
//! measured on.

use std::path::Path;

use lgs_engine::{
    gaussians::GaussianSet,
    pipeline::{Marks, Reconstruction, Silent, StageTimes, Watch},
    refine::adam::{AdamRates, RateGroup},
};
use lgs_formats::error::FormatError;
use serde::{Deserialize, Serialize};

use super::subject::Subject;
use crate::{error::Result, records::write_record};

/// Name of the file that records the search.
pub const SEARCH_FILE: &str = "rates.json";

/// How rates are searched for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SearchSettings {
    /// Numbers of steps after which a scene is measured, ascending from 1 on; a trial's score is the mean PSNR over them.
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

/// What rates are worth after each of some numbers of steps, decibels.
pub type Measure<'a> = dyn FnMut(AdamRates, &[usize]) -> Result<Vec<f64>> + 'a;

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
        Err(FormatError::invalid(&file, "settings", "those of this search", "others").into())
    }

    /// The best rates: every group's rate is raised, else lowered, by a factor as long as that helps. `measure` says what rates are worth
    /// after each number of steps ([`psnr_after`]), and is asked nothing that the record knows; `told` hears of every trial.
    ///
    /// # Errors
    /// Those of `measure`; when the record cannot be written.
    pub fn run(&mut self, dir: &Path, measure: &mut Measure<'_>, told: &mut dyn FnMut(&Trial)) -> Result<AdamRates> {
        let file = dir.join(SEARCH_FILE);
        let mut known = 0;
        let mut attempt = |search: &mut Self, rates: AdamRates| -> Result<f64> {
            if search.trials.get(known).is_none_or(|trial| trial.rates != rates) {
                search.trials.truncate(known);
                let psnr = measure(rates, &search.settings.marks)?;
                let score = psnr.iter().sum::<f64>() / psnr.len().max(1) as f64;
                let trial = Trial { rates, psnr, score };
                told(&trial);
                search.trials.push(trial);
                search.write(&file)?;
            }
            known += 1;
            Ok(search.trials[known - 1].score)
        };
        let mut best = self.settings.begin;
        let mut score = attempt(self, best)?;
        for factor in self.settings.factors.clone() {
            for group in RateGroup::ALL {
                for direction in [factor, 1.0 / factor] {
                    let before = score;
                    loop {
                        let mut rates = best;
                        *rates.of(group) *= direction;
                        let found = attempt(self, rates)?;
                        // Written so that a score that is not a number counts as no gain.
                        let better = found > score;
                        if !better {
                            break;
                        }
                        (best, score) = (rates, found);
                    }
                    if score > before {
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
        write_record(file, self)
    }
}

/// Mean PSNR of the held-out views over the scenes after each number of steps (`marks`, ascending from 1 on), decibels.
///
/// # Errors
/// When a scene cannot be measured.
pub fn psnr_after(starts: &[Start<'_>], rates: AdamRates, marks: &[usize]) -> Result<Vec<f64>> {
    let mut psnr = vec![0.0; marks.len()];
    for start in starts {
        let (mut sums, mut failed) = (psnr.iter_mut(), None);
        let mut done = |made: &Reconstruction, _: &StageTimes| match start.subject.figures(&made.scene) {
            Ok(figures) => {
                let of_mark = figures.psnr.unwrap_or(0.0) / starts.len() as f64;
                sums.next().into_iter().for_each(|sum| *sum += of_mark);
            }
            Err(error) => failed = failed.take().or(Some(error)),
        };
        let mut made = Reconstruction::of_scene(start.scene.clone());
        let run = start.subject.adam(marks.last().copied().unwrap_or(0), None, 0);
        let inputs = start.subject.session().inputs();
        made.optimise(inputs, &run, rates, &mut Watch::new(&Silent), Marks { steps: marks, done: &mut done })?;
        if let Some(error) = failed {
            return Err(error);
        }
    }
    Ok(psnr)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Best at a colour rate of 8 and a velocity rate of 0.5 times the first ones.
    fn worth(rates: AdamRates) -> Vec<f64> {
        let begin = AdamRates::default();
        let far = (rates.logit_colour / begin.logit_colour / 8.0).ln().powi(2)
            + (rates.velocity / begin.velocity / 0.5).ln().powi(2);
        vec![-far, -far]
    }

    fn settings() -> SearchSettings {
        SearchSettings { marks: vec![1, 2], factors: vec![2.0], begin: AdamRates::default(), scenes: Vec::new() }
    }

    #[test]
    fn the_best_is_found_and_what_is_known_is_not_asked_again() {
        let dir = tempfile::tempdir().unwrap();
        let mut asked = 0;
        let mut search = Search::open(dir.path(), settings()).unwrap();
        let mut measure = |rates, _: &[usize]| {
            asked += 1;
            Ok(worth(rates))
        };
        let best = search.run(dir.path(), &mut measure, &mut |_| ()).unwrap();
        let begin = AdamRates::default();
        let want = AdamRates { logit_colour: 8.0 * begin.logit_colour, velocity: 0.5 * begin.velocity, ..begin };
        assert_eq!((best, search.trials.len()), (want, asked));
        // The record of an interrupted search: what it holds is taken from there.
        let mut cut = search.clone();
        cut.trials.truncate(5);
        cut.write(&dir.path().join(SEARCH_FILE)).unwrap();
        let mut resumed = Search::open(dir.path(), settings()).unwrap();
        let mut again = 0;
        let mut measure = |rates, _: &[usize]| {
            again += 1;
            Ok(worth(rates))
        };
        resumed.run(dir.path(), &mut measure, &mut |_| ()).unwrap();
        assert_eq!((&resumed, again), (&search, asked - 5));
    }

    #[test]
    fn a_record_of_another_search_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let search = Search::open(dir.path(), settings()).unwrap();
        search.write(&dir.path().join(SEARCH_FILE)).unwrap();
        let error = Search::open(dir.path(), SearchSettings { marks: vec![9], ..settings() }).unwrap_err();
        assert!(error.to_string().contains("those of this search"), "{error}");
    }
}
