//! The whole work: every configuration on every clip, what is missing of it, and the pages that show it.

use std::path::PathBuf;

use base64::{Engine, engine::general_purpose::STANDARD};
use lgs_engine::{network::source::LoadedModel, pipeline::Session};
use lgs_formats::{digest::sha256, write::write_atomic};

use super::{
    budget_run::BudgetRun,
    case::{Case, Work, truth},
    grid::Run,
    measure::{Bench, RunEvaluation},
    pages::{ClipTable, Pages},
    record::{CLIP_FORMAT, Failed, Folders, PointRecord, SweepKey, SweepRecord},
    setting::{Setting, Weights},
};
use crate::{
    clips::{Choice, open},
    error::{MeasureError, Result},
    machine::Machine,
    records::file_stem,
};

/// Digits of a configuration's hash in the names of files.
const DIGITS: usize = 12;

/// Finds out, by the numbers of a clip and of a run, what the run's configurations are worth.
pub type Evaluate<'a> = dyn Fn(usize, usize) -> Result<RunEvaluation> + 'a;

/// Runs `lgs-infer` with a time budget on the clip of a number.
pub type RunBudget<'a> = dyn Fn(usize, f64) -> Result<BudgetRun> + 'a;

/// What progress takes for a run with a budget.
const BUDGET_WEIGHT: u64 = 8;

/// What is to be measured.
pub struct SweepJob<'a> {
    /// The clips.
    pub clips: Vec<Choice>,
    /// The networks.
    pub models: &'a [LoadedModel],
    /// Of each network, its weights as the user names them.
    pub weights: Vec<(Weights, String)>,
    /// The runs of the grid.
    pub runs: Vec<Run>,
    /// Timed runs of each.
    pub repeats: usize,
    /// Rounds before them that are not timed.
    pub warm_up: usize,
    /// SHA-256 of the weights of LPIPS; `None` where it is not measured.
    pub lpips: Option<String>,
    /// Seed of everything that is drawn at random.
    pub seed: u64,
    /// What measures.
    pub machine: Machine,
    /// Directory of the results.
    pub out: PathBuf,
    /// Finds out what runs are worth.
    pub evaluate: &'a Evaluate<'a>,
    /// Time budgets to try, seconds.
    pub budgets: Vec<f64>,
    /// Tries them.
    pub run_budget: &'a RunBudget<'a>,
}

/// Somebody who is told how far the work is.
pub trait Observer {
    /// A clip is begun.
    fn begin(&self, clip: &str);
    /// A run is done, or was before; `weight` is about what it costs.
    fn did(&self, weight: u64, done_now: bool);
    /// Something that people want to read.
    fn note(&self, line: &str);
}

/// What a job found.
#[derive(Debug, Default)]
pub struct SweepFindings {
    /// Of each clip, what stands on its page.
    pub tables: Vec<ClipTable>,
    /// What could not be measured.
    pub failed: Vec<Failed>,
}

/// A clip that is being measured.
struct Current<'a> {
    index: usize,
    case: &'a Case,
    file: PathBuf,
    record: SweepRecord,
}

impl std::fmt::Debug for SweepJob<'_> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("SweepJob").field("clips", &self.clips).field("runs", &self.runs).finish_non_exhaustive()
    }
}

impl SweepJob<'_> {
    /// What progress adds up to.
    pub fn total_weight(&self) -> u64 {
        let of_clip: u64 = self.runs.iter().map(|run| self.evaluation_weight(run) + self.time_weight(run)).sum();
        let of_budgets = BUDGET_WEIGHT * (self.budgets.len() * self.repeats) as u64;
        (of_clip + of_budgets) * self.clips.len() as u64
    }

    fn evaluation_weight(&self, run: &Run) -> u64 {
        run.weight() + 2
    }

    fn time_weight(&self, run: &Run) -> u64 {
        run.weight() * self.repeats as u64
    }

    /// What was found; it lies in the directory of the results too.
    ///
    /// # Errors
    /// Whatever is wrong with a clip; a file that cannot be written.
    pub fn run(&self, observer: &dyn Observer) -> Result<SweepFindings> {
        if self.runs.is_empty() {
            return Err(MeasureError::unfit("weights", "weights to try, or steps of `adam`", "neither"));
        }
        let case = |choice| Case::new(open(choice)?, choice);
        let cases: Vec<Case> = self.clips.iter().map(case).collect::<Result<_>>()?;
        let folders = Folders::make(&self.out)?;
        let settings: Vec<Setting> = self.runs.iter().flat_map(|run| run.settings.clone()).collect();
        let (mut records, mut found) = (Vec::new(), SweepFindings::default());
        for (index, case) in cases.iter().enumerate() {
            observer.begin(&case.clip().name);
            let mut current = self.current(index, case, &folders)?;
            self.evaluate_all(&mut current, &folders, &mut found.failed, observer)?;
            self.time_all(&mut current, &mut found.failed, observer)?;
            self.spend_all(&mut current, &mut found.failed, observer)?;
            records.push(current.record);
            found.tables = self.pages(&settings).write(&records, &found.failed)?;
        }
        Ok(found)
    }

    fn current<'c>(&self, index: usize, case: &'c Case, folders: &Folders) -> Result<Current<'c>> {
        let clip = case.clip();
        let key = SweepKey {
            format: CLIP_FORMAT.to_owned(),
            source: clip.source.clone(),
            choice: self.clips[index].recorded(),
            lpips: self.lpips.clone(),
            seed: self.seed,
            machine: self.machine.clone(),
        };
        let stem = file_stem(index, &clip.name);
        let file = folders.records.join(format!("{stem}.json"));
        if let Some(mut record) = SweepRecord::read(&file, &key)? {
            record.sessions += 1;
            return Ok(Current { index, case, file, record });
        }
        let (session, load_s) = case.open()?;
        let truth = match truth(&session)? {
            Some(crop) => Some(put_crop(folders, &format!("{stem}_truth.jpg"), &crop.jpeg()?)?),
            None => None,
        };
        let work = Work::of(&session)?;
        let (clip, load_s) = (clip.name.clone(), Some(load_s));
        let record =
            SweepRecord { key, clip, work, load_s, truth, sessions: 1, points: Vec::new(), budget_runs: Vec::new() };
        Ok(Current { index, case, file, record })
    }

    /// Finds out what the configurations are worth of which that is not known.
    fn evaluate_all(
        &self,
        current: &mut Current<'_>,
        folders: &Folders,
        failed: &mut Vec<Failed>,
        observer: &dyn Observer,
    ) -> Result<()> {
        let stem = file_stem(current.index, &current.record.clip);
        for (index, run) in self.runs.iter().enumerate() {
            let unknown = run.settings.iter().any(|setting| current.record.point(setting).is_none());
            if unknown {
                match (self.evaluate)(current.index, index) {
                    Ok(evaluation) => put_points(current, run, evaluation, folders, &stem)?,
                    Err(error) => fail(&current.record.clip, run_name(run), &error, failed, observer),
                }
                current.record.write(&current.file)?;
            }
            observer.did(self.evaluation_weight(run), unknown);
        }
        Ok(())
    }

    /// Runs every configuration until there are enough timed runs of it: all of them once, then all of them again.
    fn time_all(&self, current: &mut Current<'_>, failed: &mut Vec<Failed>, observer: &dyn Observer) -> Result<()> {
        let lacks = |record: &SweepRecord, run: &Run, round: usize| {
            run.settings.iter().any(|s| record.point(s).is_some_and(|point| point.repeats.len() <= round))
        };
        let mut loaded: Option<Session> = None;
        for round in 0..self.repeats {
            for run in &self.runs {
                let needed = lacks(&current.record, run, round);
                if needed {
                    if loaded.is_none() {
                        let (session, load_s) = current.case.open()?;
                        current.record.load_s = Some(load_s);
                        self.warm_up(&self.bench(&session), &current.record)?;
                        loaded = Some(session);
                    }
                    let Some(session) = &loaded else { continue };
                    match self.bench(session).costs(run) {
                        Ok(costs) => {
                            for (setting, cost) in run.settings.iter().zip(costs) {
                                if current.record.num_repeats(setting) <= round {
                                    current.record.add_repeat(setting, cost);
                                }
                            }
                        }
                        Err(error) => fail(&current.record.clip, run_name(run), &error, failed, observer),
                    }
                    current.record.write(&current.file)?;
                }
                observer.did(run.weight(), needed);
            }
        }
        Ok(())
    }

    /// Tries every budget until there are enough runs of it: all of them once, then all of them again.
    fn spend_all(&self, current: &mut Current<'_>, failed: &mut Vec<Failed>, observer: &dyn Observer) -> Result<()> {
        for round in 0..self.repeats {
            for &budget_s in &self.budgets {
                let needed = current.record.runs_of_budget(budget_s).count() <= round;
                if needed {
                    match (self.run_budget)(current.index, budget_s) {
                        Ok(spent) => current.record.budget_runs.push(spent),
                        Err(error) => {
                            fail(&current.record.clip, format!("time budget {budget_s} s"), &error, failed, observer);
                        }
                    }
                    current.record.write(&current.file)?;
                }
                observer.did(BUDGET_WEIGHT, needed);
            }
        }
        Ok(())
    }

    fn bench<'b>(&'b self, session: &'b Session) -> Bench<'b> {
        Bench { inputs: session.inputs(), models: self.models, seed: self.seed }
    }

    fn warm_up(&self, bench: &Bench<'_>, record: &SweepRecord) -> Result<()> {
        for _ in 0..self.warm_up {
            for run in self.runs.iter().filter(|run| run.settings.iter().all(|s| record.point(s).is_some())) {
                bench.warm_up(run)?;
            }
        }
        Ok(())
    }

    fn pages<'p>(&'p self, settings: &'p [Setting]) -> Pages<'p> {
        let Self { clips, weights, seed, machine, out, budgets, .. } = self;
        Pages { clips, settings, budgets, weights, lpips: self.lpips.as_deref(), seed: *seed, machine, out }
    }
}

fn run_name(run: &Run) -> String {
    run.settings.last().map_or(String::new(), Setting::name)
}

fn fail(clip: &str, name: String, error: &MeasureError, failed: &mut Vec<Failed>, observer: &dyn Observer) {
    observer.note(&format!("{clip}: {name}: {error}"));
    failed.push(Failed { clip: clip.to_owned(), name, reason: error.to_string() });
}

/// Keeps what the configurations of a run are worth, of those of which it was not known.
fn put_points(
    current: &mut Current<'_>,
    run: &Run,
    evaluation: RunEvaluation,
    folders: &Folders,
    stem: &str,
) -> Result<()> {
    for (setting, point) in run.settings.iter().zip(evaluation.points) {
        if current.record.point(setting).is_some() {
            continue;
        }
        let bytes = point.crop.as_deref().map(|text| STANDARD.decode(text)).transpose();
        let bytes = bytes.map_err(|e| MeasureError::Point(format!("{}: crop: {e}", setting.name())))?;
        let name = format!("{stem}_{}.jpg", &sha256(setting.identity()?.as_bytes())[..DIGITS]);
        let crop = bytes.map(|bytes| put_crop(folders, &name, &bytes)).transpose()?;
        let (setting, accuracy, peak_rss_mb) = (setting.clone(), point.accuracy, point.peak_rss_mb);
        current.record.put(PointRecord { setting, accuracy, peak_rss_mb, crop, repeats: Vec::new() });
    }
    Ok(())
}

/// Writes a crop; its name.
fn put_crop(folders: &Folders, name: &str, bytes: &[u8]) -> Result<String> {
    write_atomic(&folders.crops.join(name), bytes)?;
    Ok(name.to_owned())
}
