//! Stage 1 on a very small model and very small clips.

use lgs_engine::network::source::load_model;
use lgs_engine::pipeline::HoldOut;
use lgs_tests::{Outcome, case, clips as shipped};
use lgs_train::scenes::Split;
use lgs_train::stages::checkpoint::{State, WEIGHTS_FILE};
use lgs_train::stages::clips::TrainingClip;
use lgs_train::stages::sample::sample;
use lgs_train::stages::train::{Observer, StepReport, train};
use lgs_train::stages::validate::ValidationClip;
use libtest_mimic::Trial;

use super::fixtures::{
    Ends, FRAMES, Silent, bytes, clip, clips, config, failed, job, open, settings, spoil_odd_frames, whole_and_resumed,
};

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("train::backbone::a_run_that_was_interrupted_ends_with_the_same_bits", same_bits_after_resume),
        case("train::backbone::threads_do_not_matter", threads_do_not_matter),
        case("train::backbone::held_out_frames_are_never_read", held_out_frames_are_never_read),
        case("train::backbone::clips_of_validation_are_not_trained_on", overlap_is_refused),
        case("train::backbone::a_step_that_is_not_finite_changes_nothing", not_finite),
        case("train::backbone::the_loss_falls", the_loss_falls),
        case("train::backbone::one_clip_can_be_learnt", one_clip_can_be_learnt),
    ]
}

fn same_bits_after_resume() -> Outcome {
    let place = tempfile::tempdir()?;
    let clips = clips(place.path())?;
    let start = || State::new(&config(), settings(6)).map_err(failed);
    let Ends { whole, resumed, folder } = whole_and_resumed(place.path(), start, |out| job(&clips, out))?;
    if whole != resumed {
        return Err("the resumed run ended with other bits".into());
    }
    load_model(&folder.join(WEIGHTS_FILE)).map_err(failed)?;
    let rows = std::fs::read_to_string(folder.join("steps.csv"))?.lines().count();
    if rows == 7 { Ok(()) } else { Err(format!("expected a table of 6 steps, found {rows} lines").into()) }
}

fn threads_do_not_matter() -> Outcome {
    let place = tempfile::tempdir()?;
    let clips = clips(place.path())?;
    let mut found = Vec::new();
    for threads in [1, 2, 5] {
        let out = place.path().join(threads.to_string());
        let mut state = State::new(&config(), settings(4)).map_err(failed)?;
        let job = job(&clips, &out)?;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        pool.install(|| train(&mut state, &job, &Silent)).map_err(failed)?;
        found.push(bytes(&out)?);
    }
    if found.windows(2).all(|pair| pair[0] == pair[1]) { Ok(()) } else { Err("the bits depend on the threads".into()) }
}

/// Spoils every file of the odd frames: a run that must not read them goes on as before, one that may fails.
fn held_out_frames_are_never_read() -> Outcome {
    let place = tempfile::tempdir()?;
    let dir = clip(place.path(), "a", Split::Train.seed(1))?;
    let settings = settings(1);
    let draw =
        |clips: &[TrainingClip]| (0..12).map(|step| sample(clips, &settings, step)).collect::<Result<Vec<_>, _>>();
    let before = draw(&open(&dir, &HoldOut::Odd)?).map_err(failed)?;
    spoil_odd_frames(&dir)?;
    let after = draw(&open(&dir, &HoldOut::Odd)?).map_err(failed)?;
    for (before, after) in before.iter().zip(&after) {
        let frames = after.inputs.iter().chain(&after.targets).map(|view| view.frame);
        if let Some(frame) = frames.into_iter().find(|frame| frame % 2 == 1) {
            return Err(format!("frame {frame} is held out, yet it was drawn").into());
        }
        if before.scene != after.scene || before.inputs != after.inputs || before.targets != after.targets {
            return Err(format!("step {} depends on what is held out", before.step).into());
        }
    }
    match draw(&open(&dir, &HoldOut::Nothing)?) {
        Ok(_) => Err("spoiled files that may be read went unnoticed".into()),
        Err(_) => Ok(()),
    }
}

fn overlap_is_refused() -> Outcome {
    let place = tempfile::tempdir()?;
    let clips = clips(place.path())?;
    let mut job = job(&clips, &place.path().join("out"))?;
    job.task.validation = vec![ValidationClip::open(&clips.join("b"), FRAMES, None).map_err(failed)?];
    let mut state = State::new(&config(), settings(1)).map_err(failed)?;
    match train(&mut state, &job, &Silent) {
        Err(error) if error.to_string().contains("not trained on") => Ok(()),
        other => Err(format!("expected a refusal, found {other:?}").into()),
    }
}

fn not_finite() -> Outcome {
    let place = tempfile::tempdir()?;
    let clips = clips(place.path())?;
    let mut spoiled = settings(3);
    spoiled.calibration = 0;
    let mut state = State::new(&config(), spoiled).map_err(failed)?;
    let specs = state.variables.specs();
    let k = specs.iter().position(|s| s.name == "initial.heads.gaussian.bias").ok_or("no such tensor")?;
    state.variables.set(k, vec![f32::NAN; specs[k].len()]).map_err(failed)?;
    let before = state.variables.values().map_err(failed)?;
    train(&mut state, &job(&clips, &place.path().join("out"))?, &Silent).map_err(failed)?;
    let after = state.variables.values().map_err(failed)?;
    let bits = |values: &[Vec<f32>]| values.concat().iter().map(|v| v.to_bits()).collect::<Vec<u32>>();
    if state.skipped != 3 || bits(&before) != bits(&after) {
        return Err(format!("{} of 3 steps skipped", state.skipped).into());
    }
    Ok(())
}

/// Losses after the last refinement step.
#[derive(Default)]
struct Losses(std::cell::RefCell<Vec<[f64; 2]>>);

impl Observer for Losses {
    fn step(&self, _: u64, report: &StepReport<'_>) {
        let [first, last] = ["inputs_after_0", "inputs_after_2"].map(|name| report.value(name).unwrap_or(f64::NAN));
        self.0.borrow_mut().push([first, last]);
    }

    fn validated(&self, _: u64, _: &str) {}
}

/// After a few steps refinement gains on the views that it is given, of clips and crops that change from step to step.
fn the_loss_falls() -> Outcome {
    let place = tempfile::tempdir()?;
    let clips = clips(place.path())?;
    let mut state = State::new(&config(), settings(30)).map_err(failed)?;
    let losses = Losses::default();
    train(&mut state, &job(&clips, &place.path().join("out"))?, &losses).map_err(failed)?;
    let gains: Vec<f64> = losses.0.borrow().iter().map(|[first, last]| 1.0 - last / first).collect();
    let late = gains[20..].iter().sum::<f64>() / 10.0;
    if late > 0.02 {
        Ok(())
    } else {
        Err(format!("refinement lowers the loss by {:.1} %: {gains:?}", 100.0 * late).into())
    }
}

/// The shipped clip alone: the losses after the refinement of late steps are far below those of the first ones.
fn one_clip_can_be_learnt() -> Outcome {
    const STEPS: usize = 60;
    let place = tempfile::tempdir()?;
    let mut settings = settings(STEPS as u64);
    (settings.schedule.peak, settings.crop, settings.max_views) = (5e-3, [48, 80], 2);
    (settings.perturbed, settings.pruned, settings.mirrored, settings.noise) = (0.0, 0.0, 0.0, 0.0);
    let mut state = State::new(&config(), settings).map_err(failed)?;
    let losses = Losses::default();
    let mut job = job(&shipped::street(), &place.path().join("out"))?;
    job.checkpoint_every = STEPS as u64;
    train(&mut state, &job, &losses).map_err(failed)?;
    let losses = losses.0.borrow();
    let mean = |part: &[[f64; 2]], k: usize| part.iter().map(|l| l[k]).sum::<f64>() / part.len() as f64;
    let [first, late] = [&losses[..20], &losses[STEPS - 20..]];
    let fall = 1.0 - mean(late, 1) / mean(first, 1);
    if fall > 0.25 { Ok(()) } else { Err(format!("the loss falls by {:.1} %", 100.0 * fall).into()) }
}
