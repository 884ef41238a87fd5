//! The loop of stage 1: samples, steps, checkpoints, validation.

use std::{
    path::{Path, PathBuf},
    sync::mpsc::sync_channel,
    time::Instant,
};

use lgs_engine::network::{model::FoldedModel, weights::TensorSpec};
use lgs_formats::error::FormatError;

use super::{
    adamw::{self, Update},
    backbone::{Computed, compute},
    checkpoint::State,
    clips::TrainingClip,
    plot::plot,
    record::Table,
    sample::{Sample, sample},
    validate::{Score, ValidationClip, mean_score},
    variables::Variables,
};
use crate::error::{Result, TrainError};

/// Samples that are made ahead.
const AHEAD: usize = 2;
/// Tensors that this stage leaves as they are begin so.
const OTHER_STAGES: &str = "policy.";

/// Where a run reads and writes, and how often.
#[derive(Debug)]
pub struct Job {
    /// Clips that the network learns from.
    pub clips: Vec<TrainingClip>,
    /// Clips that it is measured on.
    pub validation: Vec<ValidationClip>,
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
    fn step(&self, step: u64, row: &StepReport);
    /// A validation is done.
    fn validated(&self, step: u64, score: &Score);
}

/// What one step did.
#[derive(Clone, Debug)]
pub struct StepReport {
    /// The learning rate.
    pub rate: f64,
    /// Losses of the input views and of the target views, after the prediction and after every refinement step.
    pub losses: Vec<super::backbone::Losses>,
    /// Norm of the whole gradient before it was cut; NaN when the step was skipped.
    pub gradient: f64,
    /// Seconds.
    pub seconds: f64,
    /// Gaussians of both branches.
    pub gaussians: [usize; 2],
}

/// Trains until the last step of the settings.
///
/// # Errors
/// Whatever is wrong with a clip; a file that cannot be written; a validation clip that is trained on.
pub fn train(state: &mut State, job: &Job, observer: &dyn Observer) -> Result<()> {
    refuse_overlap(job)?;
    std::fs::create_dir_all(&job.out).map_err(|e| FormatError::io(&job.out, "create", e))?;
    let mut tables = Tables::open(&job.out, state)?;
    let (first, last) = (state.step, state.settings.schedule.steps);
    let settings = state.settings.clone();
    std::thread::scope(|scope| {
        let (sender, receiver) = sync_channel::<Result<Sample>>(AHEAD);
        scope.spawn(move || {
            for step in first..last {
                // The other end is gone when a step has failed.
                if sender.send(sample(&job.clips, &settings, step)).is_err() {
                    break;
                }
            }
        });
        if first == 0 {
            validate(state, job, &mut tables, observer)?;
        }
        for made in receiver {
            let start = Instant::now();
            let mut report = one_step(state, made?)?;
            report.seconds = start.elapsed().as_secs_f64();
            tables.push(state, &report);
            observer.step(state.step, &report);
            let done = state.step == last;
            if done || state.step.is_multiple_of(job.validate_every) {
                validate(state, job, &mut tables, observer)?;
            }
            if done || state.step.is_multiple_of(job.checkpoint_every) {
                state.write(&job.out)?;
                tables.steps.write()?;
                tables.draw(&job.out)?;
            }
        }
        Ok(())
    })
}

fn refuse_overlap(job: &Job) -> Result<()> {
    let trained: Vec<String> = job.clips.iter().map(TrainingClip::identity).collect();
    match job.validation.iter().find(|clip| trained.contains(&clip.identity)) {
        Some(clip) => Err(TrainError::config("validation", "clips that are not trained on", &clip.identity)),
        None => Ok(()),
    }
}

fn is_trained(spec: &TensorSpec) -> bool {
    spec.is_parameter() && !spec.name.starts_with(OTHER_STAGES)
}

/// One step. One that meets a value that is not finite changes nothing and is counted.
fn one_step(state: &mut State, mut sample: Sample) -> Result<StepReport> {
    let rate = state.settings.schedule.rate(state.step);
    let before = state.variables.values()?;
    let mut computed = compute(&state.variables, &state.settings, &mut sample)?;
    let specs = state.variables.specs();
    let norm = adamw::norm(&computed.gradients, specs, is_trained);
    let finite = norm.is_finite() && computed.losses.iter().all(|l| l.inputs.is_finite() && l.targets.is_finite());
    state.step += 1;
    let Computed { losses, gaussians, .. } = &computed;
    let (losses, gaussians) = (losses.clone(), *gaussians);
    if !finite || sample.scene.is_empty() {
        state.skipped += 1;
        // Running statistics may have followed what was not finite.
        for (k, values) in before.into_iter().enumerate() {
            state.variables.set(k, values)?;
        }
        return Ok(StepReport { rate, losses, gradient: f64::NAN, seconds: 0.0, gaussians });
    }
    if state.settings.calibrates(sample.step) {
        state.average = state.variables.values()?;
        return Ok(StepReport { rate: 0.0, losses, gradient: norm, seconds: 0.0, gaussians });
    }
    if norm > state.settings.max_gradient {
        adamw::scale(&mut computed.gradients, state.settings.max_gradient / norm);
    }
    let update = Update { rate, decay: state.settings.weight_decay };
    state.adam.update(&state.variables, &computed.gradients, update, is_trained)?;
    follow(state)?;
    Ok(StepReport { rate, losses, gradient: norm, seconds: 0.0, gaussians })
}

/// Moves the average towards the weights; quickly at first.
fn follow(state: &mut State) -> Result<()> {
    let updates = state.adam.updates as f64;
    let keep = crate::scenes::maths::narrow(state.settings.average.min((1.0 + updates) / (10.0 + updates)));
    for (average, values) in state.average.iter_mut().zip(state.variables.values()?) {
        average.iter_mut().zip(values).for_each(|(a, v)| *a = keep * *a + (1.0 - keep) * v);
    }
    Ok(())
}

fn validate(state: &State, job: &Job, tables: &mut Tables, observer: &dyn Observer) -> Result<()> {
    if job.validation.is_empty() {
        return Ok(());
    }
    let variables = Variables::with_values(state.variables.config(), &state.average)?;
    let model: FoldedModel = variables.model()?.fold(variables.config())?;
    let score = mean_score(&job.validation, &model, state.settings.refine_steps)?;
    tables.validation.push([state.step as f64, score.start].into_iter().chain(score.after.clone()).collect());
    tables.validation.write()?;
    observer.validated(state.step, &score);
    Ok(())
}

/// What is recorded of a run.
struct Tables {
    steps: Table,
    validation: Table,
}

impl Tables {
    fn open(dir: &Path, state: &State) -> Result<Self> {
        let states: Vec<String> = (0..=state.settings.refine_steps).map(|k| format!("after_{k}")).collect();
        let losses = |kind: &str| states.iter().map(|s| format!("{kind}_{s}")).collect::<Vec<_>>();
        let names = |names: &[&str]| names.iter().map(ToString::to_string).collect::<Vec<_>>();
        let columns =
            [names(&["step", "rate", "gradient", "seconds", "lidar", "background"]), losses("inputs")].concat();
        let columns = [columns, losses("targets"), names(&["l1", "dissimilarity", "depth", "speed"])].concat();
        let steps = Table::open(dir.join("steps.csv"), columns, state.step)?;
        let columns = [names(&["step", "start"]), states].concat();
        let validation = Table::open(dir.join("validation.csv"), columns, state.step)?;
        Ok(Self { steps, validation })
    }

    /// Pictures of the tables.
    fn draw(&self, dir: &Path) -> Result<()> {
        let starting = |table: &Table, prefix: &str| -> Vec<usize> {
            let named = table.columns().iter().enumerate().filter(|(_, name)| name.starts_with(prefix));
            named.map(|(k, _)| k).collect()
        };
        let parts = ["l1", "dissimilarity", "depth", "speed"].map(|name| starting(&self.steps, name)).concat();
        let pictures = [
            (&self.steps, starting(&self.steps, "inputs"), "loss of the input views", "loss_inputs.png"),
            (&self.steps, starting(&self.steps, "targets"), "loss of the target views", "loss_targets.png"),
            (&self.steps, parts, "terms of the loss of the target views after the last step", "loss_terms.png"),
            (&self.steps, starting(&self.steps, "gradient"), "norm of the gradient", "gradient.png"),
            (&self.validation, (1..self.validation.columns().len()).collect(), "validation PSNR, dB", "validation.png"),
        ];
        pictures.iter().try_for_each(|(table, columns, title, file)| plot(table, columns, title, &dir.join(file)))
    }

    fn push(&mut self, state: &State, report: &StepReport) {
        let [lidar, background] = report.gaussians.map(|n| n as f64);
        let mut row = vec![state.step as f64, report.rate, report.gradient, report.seconds, lidar, background];
        row.extend(report.losses.iter().map(|l| l.inputs));
        row.extend(report.losses.iter().map(|l| l.targets));
        let last = report.losses.last().map(|l| l.terms).unwrap_or_default();
        row.extend([last.l1, last.dissimilarity, last.depth, last.speed]);
        self.steps.push(row);
    }
}
