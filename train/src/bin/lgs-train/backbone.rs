//! Acts on the flags of `backbone`.

use std::path::PathBuf;

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};
use lgs_engine::{network::config::ModelConfig, threads};
use lgs_train::stages::{
    checkpoint::State,
    clips::{TrainingClip, find},
    train::{Job, Observer, StepReport, train},
    validate::{Score, ValidationClip},
};

use crate::backbone_args::BackboneArgs;

/// The text for standard output.
pub(crate) fn backbone(args: &BackboneArgs) -> Result<String> {
    threads::set_pools(args.threads, Some(std::num::NonZeroUsize::MIN))?;
    let mut state = match &args.config {
        Some(config) if !args.resume => State::new(&ModelConfig::read(config)?, args.settings())?,
        _ => State::read(&args.out)?,
    };
    if let Some(steps) = args.steps {
        state.settings.schedule.steps = steps;
        state.settings.validate()?;
    }
    let clips =
        all(&args.clips)?.iter().map(|dir| TrainingClip::open(dir, &args.hold_out)).collect::<Result<_, _>>()?;
    let validation = all(&args.validation)?.into_iter().take(args.validation_clips);
    let open = |dir: PathBuf| ValidationClip::open(&dir, 5, Some(args.validation_size));
    let validation = validation.map(open).collect::<Result<_, _>>()?;
    let job = Job {
        clips,
        validation,
        out: args.out.clone(),
        checkpoint_every: args.checkpoint_every,
        validate_every: args.validate_every,
    };
    let bar = ProgressBar::new(state.settings.schedule.steps).with_position(state.step);
    bar.set_style(ProgressStyle::with_template("train {wide_bar} {pos}/{len} steps {eta} {msg}")?);
    let watch = Watch { bar };
    train(&mut state, &job, &watch).with_context(|| format!("after {} steps", state.step))?;
    watch.bar.finish_and_clear();
    Ok(format!("{} steps in {}, {} of them skipped", state.step, args.out.display(), state.skipped))
}

fn all(paths: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let found: Vec<Vec<PathBuf>> = paths.iter().map(|path| find(path)).collect::<Result<_, _>>()?;
    Ok(found.concat())
}

/// Progress on standard error.
struct Watch {
    bar: ProgressBar,
}

impl Watch {
    /// A line that stays, also where standard error is no terminal.
    fn line(&self, text: &str) {
        if self.bar.is_hidden() {
            use std::io::Write;
            // Nobody reads what cannot be written.
            let _ = writeln!(std::io::stderr(), "{text}");
        } else {
            self.bar.println(text);
        }
    }
}

impl Observer for Watch {
    fn step(&self, step: u64, report: &StepReport) {
        self.bar.set_position(step);
        let losses: Vec<String> = report.losses.iter().map(|l| format!("{:.4}", l.targets)).collect();
        let text = format!("loss {} gradient {:.2e} {:.1} s", losses.join(" "), report.gradient, report.seconds);
        self.bar.set_message(text.clone());
        if self.bar.is_hidden() && (step < 10 || step.is_multiple_of(25)) {
            self.line(&format!("step {step}: {text} ({} + {} Gaussians)", report.gaussians[0], report.gaussians[1]));
        }
    }

    fn validated(&self, step: u64, score: &Score) {
        let after: Vec<String> = score.after.iter().map(|psnr| format!("{psnr:.2}")).collect();
        self.line(&format!("step {step}: validation {:.2} dB at the start, then {}", score.start, after.join(" ")));
    }
}
