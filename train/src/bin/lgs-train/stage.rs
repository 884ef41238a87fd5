//! Acts on the flags of the stages of training.

use std::{
    num::NonZeroUsize,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result};
use lgs_cli::{progress::Bar, threads};
use lgs_engine::{network::config::ModelConfig, network::source::load_model};
use lgs_targetgen::job::find_clips;
use lgs_train::stages::{
    checkpoint::State,
    clips::{TrainingClip, find},
    frozen::FrozenPolicy,
    policy::{PolicyTask, Recompute, ShardClips, ShardOptions},
    rendering::Rendering,
    settings::{RunSettings, StageName},
    task::Task,
    train::{Job, Observer, StepReport, train},
    validate::ValidationClip,
    weights::{Precision, StartWeights, write_weights},
};

use crate::{
    args::ExportArgs,
    backbone_args::BackboneArgs,
    finetune_args::FinetuneArgs,
    policy_args::PolicyArgs,
    stage_args::{RenderingArgs, RunArgs},
};

/// Stage 1: the text for standard output.
pub(crate) fn backbone(args: &BackboneArgs) -> Result<String> {
    set_pools(&args.run)?;
    let state = match (&args.config, &args.weights) {
        _ if args.run.resume => State::read(&args.run.out, StageName::Backbone)?,
        (_, Some(weights)) => State::of(StartWeights::read(weights)?.variables, args.settings())?,
        (Some(config), None) => State::new(&ModelConfig::read(config)?, args.settings())?,
        (None, None) => State::read(&args.run.out, StageName::Backbone)?,
    };
    run(state, rendering(&args.rendering, None)?, &args.run)
}

/// Stage 2: the text for standard output.
pub(crate) fn policy(args: &PolicyArgs) -> Result<String> {
    set_pools(&args.run)?;
    let start = StartWeights::read(&args.weights)?;
    let config = start.variables.config().clone();
    let recompute = match args.clips.as_slice() {
        [] => None,
        clips => Some(Recompute {
            model: load_model(&args.weights)?.model,
            clips: find_clips(clips)?,
            always: args.recompute,
        }),
    };
    let options =
        ShardOptions { weights: &start.sha256, config: &config, hold_out_every: args.hold_out_every, recompute };
    let task = PolicyTask::new(ShardClips::open(&args.shards, options)?, args.validation_clips, &config)?;
    let state = match args.run.resume {
        true => State::read(&args.run.out, StageName::Policy)?,
        false => State::of(start.variables, args.settings())?,
    };
    run(state, task, &args.run)
}

/// Stage 3: the text for standard output.
pub(crate) fn finetune(args: &FinetuneArgs) -> Result<String> {
    set_pools(&args.run)?;
    let state = match &args.weights {
        Some(weights) if !args.run.resume => State::of(StartWeights::read(weights)?.variables, args.settings())?,
        _ => State::read(&args.run.out, StageName::Finetune)?,
    };
    let policy = FrozenPolicy::of(&state.variables)?;
    run(state, rendering(&args.rendering, Some(policy))?, &args.run)
}

/// A copy of weights: the text for standard output.
pub(crate) fn export(args: &ExportArgs) -> Result<String> {
    let weights = StartWeights::read(&args.weights)?;
    let precision = if args.half { Precision::Half } else { Precision::Full };
    write_weights(&weights.variables, precision, &args.out)?;
    let bytes = std::fs::metadata(&args.out).with_context(|| args.out.display().to_string())?.len();
    let digest = StartWeights::read(&args.out)?.sha256;
    Ok(format!("{}: {bytes} bytes, SHA-256 {digest}", args.out.display()))
}

fn set_pools(args: &RunArgs) -> Result<()> {
    // The tensor library's own threads would wait by spinning beside ours.
    threads::set_pools(args.threads, Some(NonZeroUsize::MIN))?;
    Ok(())
}

fn rendering(args: &RenderingArgs, policy: Option<FrozenPolicy>) -> Result<Rendering> {
    let clips =
        all(&args.clips)?.iter().map(|dir| TrainingClip::open(dir, &args.hold_out)).collect::<Result<_, _>>()?;
    let validation = all(&args.validation)?.into_iter().take(args.validation_clips);
    let open = |dir: PathBuf| ValidationClip::open(&dir, 5, Some(args.validation_size));
    Ok(Rendering { clips, validation: validation.map(open).collect::<Result<_, _>>()?, policy })
}

fn all(paths: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let found: Vec<Vec<PathBuf>> = paths.iter().map(|path| find(path)).collect::<Result<_, _>>()?;
    Ok(found.concat())
}

fn run<T: Task>(mut state: State<T::Settings>, task: T, args: &RunArgs) -> Result<String> {
    if let Some(steps) = args.steps {
        state.settings.schedule_mut().steps = steps;
        state.settings.validate()?;
    }
    let RunArgs { out, checkpoint_every, validate_every, .. } = args.clone();
    let job = Job { task, out, checkpoint_every, validate_every };
    let bar = Bar::new("train", state.settings.optimisation().schedule.steps);
    bar.set_position(state.step);
    let watch = Watch { bar };
    train(&mut state, &job, &watch).with_context(|| format!("after {} steps", state.step))?;
    drop(watch);
    let out: &Path = &job.out;
    Ok(format!("{} steps in {}, {} of them skipped", state.step, out.display(), state.skipped))
}

/// Progress on standard error.
struct Watch {
    bar: Bar,
}

impl Observer for Watch {
    fn step(&self, step: u64, report: &StepReport<'_>) {
        self.bar.set_position(step);
        let text = format!("{} gradient {:.2e} {:.1} s", report.text, report.gradient, report.seconds);
        self.bar.message(text.clone());
        if self.bar.is_hidden() && (step < 10 || step.is_multiple_of(25)) {
            self.bar.line(&format!("step {step}: {text}"));
        }
    }

    fn validated(&self, step: u64, text: &str) {
        self.bar.line(&format!("step {step}: validation {text}"));
    }
}
