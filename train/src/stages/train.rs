//! The loop of every stage: samples, steps, checkpoints, validation.

use std::{
    path::{Path, PathBuf},
    sync::mpsc::sync_channel,
    time::Instant,
};

use lgs_engine::network::weights::TensorSpec;
use lgs_formats::error::FormatError;

use super::{
    adamw::{self, Update},
    checkpoint::State,
    plot::plot,
    record::Table,
    settings::RunSettings,
    task::Task,
    variables::Variables,
};
use crate::error::Result;

/// Samples that are made ahead.
const AHEAD: usize = 2;

/// A stage, where its run writes, and how often.
#[derive(Debug)]
pub struct Job<T> {
    /// The stage.
    pub task: T,
    /// Directory of checkpoints, tables and pictures.
    pub out: PathBuf,
    /// Steps between two checkpoints.
    pub checkpoint_every: u64,
    /// Steps between two validations.
    pub validate_every: u64,
}

/// Somebody who is told how far a run is.
pub trait Observer {
    /// A step is done.
    fn step(&self, step: u64, report: &StepReport<'_>);
    /// A validation is done.
    fn validated(&self, step: u64, text: &str);
}

/// What one step did.
#[derive(Clone, Debug)]
pub struct StepReport<'a> {
    /// The learning rate.
    pub rate: f64,
    /// Norm of the whole gradient before it was cut; NaN when the step was skipped.
    pub gradient: f64,
    /// Seconds.
    pub seconds: f64,
    /// Names of `values`.
    pub columns: &'a [String],
    /// What the stage records.
    pub values: Vec<f64>,
    /// The values in a few words.
    pub text: String,
}

impl StepReport<'_> {
    /// The value of a column.
    pub fn value(&self, column: &str) -> Option<f64> {
        let at = self.columns.iter().position(|name| name == column)?;
        self.values.get(at).copied()
    }
}

/// Trains until the last step of the settings.
///
/// # Errors
/// Whatever is wrong with what is read; a file that cannot be written; something to measure on that is trained on.
pub fn train<T: Task>(state: &mut State<T::Settings>, job: &Job<T>, observer: &dyn Observer) -> Result<()> {
    job.task.check()?;
    std::fs::create_dir_all(&job.out).map_err(|e| FormatError::io(&job.out, "create", e))?;
    let columns = job.task.columns(&state.settings);
    let mut tables = Tables::open(&job.out, state.step, &columns.step, &columns.validation)?;
    let (first, last) = (state.step, state.settings.optimisation().schedule.steps);
    let settings = state.settings.clone();
    std::thread::scope(|scope| {
        let (sender, receiver) = sync_channel::<Result<T::Sample>>(AHEAD);
        scope.spawn(move || {
            for step in first..last {
                // The other end is gone when a step has failed.
                if sender.send(job.task.sample(&settings, step)).is_err() {
                    break;
                }
            }
        });
        if first == 0 {
            validate(state, job, &mut tables, observer)?;
        }
        for made in receiver {
            let start = Instant::now();
            let mut report = one_step(state, &job.task, made?, &columns.step)?;
            report.seconds = start.elapsed().as_secs_f64();
            tables.push(state.step, &report);
            observer.step(state.step, &report);
            let done = state.step == last;
            if done || state.step.is_multiple_of(job.validate_every) {
                validate(state, job, &mut tables, observer)?;
            }
            if done || state.step.is_multiple_of(job.checkpoint_every) {
                state.write(&job.out)?;
                tables.steps.write()?;
                tables.draw(&job.task, &job.out)?;
            }
        }
        Ok(())
    })
}

/// One step. One that meets a value that is not finite changes nothing and is counted.
fn one_step<'a, T: Task>(
    state: &mut State<T::Settings>,
    task: &T,
    sample: T::Sample,
    columns: &'a [String],
) -> Result<StepReport<'a>> {
    let options = state.settings.optimisation();
    let trained = |spec: &TensorSpec| spec.is_parameter() && task.trains(spec);
    let before = state.variables.values()?;
    let mut computed = task.compute(&state.variables, &state.settings, sample)?;
    let norm = adamw::norm(&computed.gradients, state.variables.specs(), trained);
    let calibrates = state.settings.calibrates(state.step);
    let rate = if calibrates { 0.0 } else { options.schedule.rate(state.step) };
    let text = task.step_text(&state.settings, &computed.values);
    state.step += 1;
    let values = std::mem::take(&mut computed.values);
    let report = StepReport { rate, gradient: norm, seconds: 0.0, columns, values, text };
    if !norm.is_finite() || !computed.usable {
        state.skipped += 1;
        // Running statistics may have followed what was not finite.
        for (k, values) in before.into_iter().enumerate() {
            state.variables.set(k, values)?;
        }
        return Ok(StepReport { gradient: f64::NAN, ..report });
    }
    if calibrates {
        state.average = state.variables.values()?;
        return Ok(report);
    }
    if norm > options.max_gradient {
        adamw::scale(&mut computed.gradients, options.max_gradient / norm);
    }
    let update = Update { rate, decay: options.weight_decay };
    state.adam.update(&state.variables, &computed.gradients, update, trained)?;
    follow(state, options.average)?;
    Ok(report)
}

/// Moves the average towards the weights; quickly at first.
fn follow<S: RunSettings>(state: &mut State<S>, average: f64) -> Result<()> {
    let updates = state.adam.updates as f64;
    let keep = crate::scenes::maths::narrow(average.min((1.0 + updates) / (10.0 + updates)));
    for (average, values) in state.average.iter_mut().zip(state.variables.values()?) {
        average.iter_mut().zip(values).for_each(|(a, v)| *a = keep * *a + (1.0 - keep) * v);
    }
    Ok(())
}

fn validate<T: Task>(
    state: &State<T::Settings>,
    job: &Job<T>,
    tables: &mut Tables,
    observer: &dyn Observer,
) -> Result<()> {
    let variables = Variables::with_values(state.variables.config(), &state.average)?;
    let Some(values) = job.task.score(&variables, &state.settings)? else { return Ok(()) };
    let text = job.task.score_text(&values);
    tables.validation.push([state.step as f64].into_iter().chain(values).collect());
    tables.validation.write()?;
    observer.validated(state.step, &text);
    Ok(())
}

/// What is recorded of a run.
struct Tables {
    steps: Table,
    validation: Table,
}

impl Tables {
    fn open(dir: &Path, step: u64, of_steps: &[String], of_validation: &[String]) -> Result<Self> {
        let named = |first: &[&str], rest: &[String]| -> Vec<String> {
            first.iter().map(ToString::to_string).chain(rest.iter().cloned()).collect()
        };
        let steps = named(&["step", "rate", "gradient", "seconds"], of_steps);
        Ok(Self {
            steps: Table::open(dir.join("steps.csv"), steps, step)?,
            validation: Table::open(dir.join("validation.csv"), named(&["step"], of_validation), step)?,
        })
    }

    /// Pictures of the tables.
    fn draw<T: Task>(&self, task: &T, dir: &Path) -> Result<()> {
        for picture in task.pictures() {
            let named = self.steps.columns().iter().enumerate();
            let wanted = named.filter(|(_, name)| picture.prefixes.iter().any(|prefix| name.starts_with(prefix)));
            let columns: Vec<usize> = wanted.map(|(k, _)| k).collect();
            plot(&self.steps, &columns, picture.title, &dir.join(picture.file))?;
        }
        let all: Vec<usize> = (1..self.validation.columns().len()).collect();
        plot(&self.validation, &all, "validation", &dir.join("validation.svg"))
    }

    fn push(&mut self, step: u64, report: &StepReport<'_>) {
        let mut row = vec![step as f64, report.rate, report.gradient, report.seconds];
        row.extend(&report.values);
        self.steps.push(row);
    }
}
