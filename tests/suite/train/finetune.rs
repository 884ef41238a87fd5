//! Stage 3 on a very small model and very small clips.

use std::path::Path;

use lgs_engine::{densify::Limit, pipeline::HoldOut};
use lgs_tests::{Outcome, case};
use lgs_train::scenes::Split;
use lgs_train::stages::checkpoint::State;
use lgs_train::stages::frozen::FrozenPolicy;
use lgs_train::stages::rendering::Rendering;
use lgs_train::stages::settings::{Settings, StageName};
use lgs_train::stages::task::Task;
use lgs_train::stages::train::{Job, train};
use lgs_train::stages::variables::Variables;
use libtest_mimic::{Failed, Trial};

use super::fixtures::{
    Ends, Silent, clip, clips, config, config_with_policy, failed, open, settings, spoil_odd_frames, whole_and_resumed,
};

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("train::finetune::a_run_that_was_interrupted_ends_with_the_same_bits", same_bits_after_resume),
        case("train::finetune::the_policy_decides_and_stays", the_policy_decides_and_stays),
        case("train::finetune::held_out_frames_are_never_read", held_out_frames_are_never_read),
        case("train::finetune::stages_are_not_mixed_up", stages_are_not_mixed_up),
    ]
}

fn finetuning(steps: u64, thresholds: [f32; 2]) -> Settings {
    Settings { calibration: 0, thresholds: Some(thresholds), ..settings(steps) }
}

/// A model whose policy scores near 1/2, so that thresholds decide what it does.
fn start(settings: Settings) -> Result<State<Settings>, Failed> {
    State::of(Variables::seeded(&config_with_policy(), 4).map_err(failed)?, settings).map_err(failed)
}

fn job(clips: &Path, hold_out: &HoldOut, out: &Path) -> Result<Job<Rendering>, Failed> {
    let variables = Variables::seeded(&config_with_policy(), 4).map_err(failed)?;
    let policy = Some(FrozenPolicy::of(&variables).map_err(failed)?);
    let task = Rendering { clips: open(clips, hold_out)?, validation: Vec::new(), policy };
    Ok(Job { task, out: out.to_owned(), checkpoint_every: 3, validate_every: 3 })
}

fn same_bits_after_resume() -> Outcome {
    let place = tempfile::tempdir()?;
    let clips = clips(place.path())?;
    let job = |out: &Path| job(&clips, &HoldOut::Nothing, out);
    let Ends { whole, resumed, .. } = whole_and_resumed(place.path(), || start(finetuning(6, [0.4, 0.4])), job)?;
    if whole == resumed { Ok(()) } else { Err("the resumed run ended with other bits".into()) }
}

/// Gaussians of the `LiDAR` branch in the first step.
fn gaussians(clips: &Path, out: &Path, settings: Settings) -> Result<f64, Failed> {
    let (state, job) = (start(settings)?, job(clips, &HoldOut::Nothing, out)?);
    let sample = job.task.sample(&state.settings, 0).map_err(failed)?;
    let computed = job.task.compute(&state.variables, &state.settings, sample).map_err(failed)?;
    Ok(computed.values[0])
}

/// Scores of an untrained policy are 1/2: thresholds below make it prune all, or copy all; above, it does nothing.
fn the_policy_decides_and_stays() -> Outcome {
    let place = tempfile::tempdir()?;
    let (clips, out) = (clips(place.path())?, place.path().join("out"));
    let mean_count = |thresholds| gaussians(&clips, &out, finetuning(1, thresholds));
    let (nothing, copied, pruned) = (mean_count([0.7, 0.7])?, mean_count([0.7, 0.3])?, mean_count([0.3, 0.7])?);
    let limited = Settings { max_gaussians: Some(Limit::Percent(70)), ..finetuning(1, [0.7, 0.7]) };
    let left = gaussians(&clips, &out, limited)?;
    if left != (0.7 * nothing).floor() {
        return Err(format!("expected seven in ten of {nothing} Gaussians, found {left}").into());
    }
    if nothing <= 0.0 || copied != 2.0 * nothing || pruned != 0.0 {
        return Err(
            format!("found {nothing} Gaussians, {copied} where all are copied, {pruned} where none stays").into()
        );
    }
    let mut state = start(finetuning(3, [0.7, 0.3]))?;
    let before = state.variables.values().map_err(failed)?;
    train(&mut state, &job(&clips, &HoldOut::Nothing, &out)?, &Silent).map_err(failed)?;
    let after = state.variables.values().map_err(failed)?;
    for (spec, (before, after)) in state.variables.specs().iter().zip(before.iter().zip(&after)) {
        if spec.name.starts_with("policy.") && before != after {
            return Err(format!("{} is of the policy, yet it moved", spec.name).into());
        }
    }
    if before == after { Err("nothing was trained".into()) } else { Ok(()) }
}

/// Spoils what is held out: a run that must not read it ends with the same bits.
fn held_out_frames_are_never_read() -> Outcome {
    let place = tempfile::tempdir()?;
    let dir = clip(place.path(), "a", Split::Train.seed(1))?;
    let run = |name: &str| -> Result<Vec<Vec<f32>>, Failed> {
        let mut state = start(finetuning(4, [0.7, 0.3]))?;
        train(&mut state, &job(&dir, &HoldOut::Odd, &place.path().join(name))?, &Silent).map_err(failed)?;
        state.variables.values().map_err(failed)
    };
    let before = run("before")?;
    spoil_odd_frames(&dir)?;
    if run("after")? == before { Ok(()) } else { Err("the weights depend on what is held out".into()) }
}

fn stages_are_not_mixed_up() -> Outcome {
    let place = tempfile::tempdir()?;
    start(finetuning(1, [0.7, 0.7]))?.write(place.path()).map_err(failed)?;
    match State::<Settings>::read(place.path(), StageName::Backbone) {
        Err(error) if error.to_string().contains("stage: expected Backbone, found Finetune") => {}
        other => return Err(format!("expected a refusal, found {:?}", other.map(|state| state.step)).into()),
    }
    match FrozenPolicy::of(&Variables::seeded(&config(), 1).map_err(failed)?) {
        Err(error) if error.to_string().contains("a model with a policy") => Ok(()),
        other => Err(format!("expected a refusal, found {other:?}").into()),
    }
}
