//! Stage 1 on a very small model and very small clips.

use std::path::{Path, PathBuf};

use lgs_engine::network::config::{MODEL_FORMAT, ModelConfig, QueryConfig};
use lgs_engine::network::source::load_model;
use lgs_engine::network::unet::UNetConfig;
use lgs_engine::pipeline::HoldOut;
use lgs_tests::{Outcome, case};
use lgs_train::scenes::export::{Export, ImageFormat, write};
use lgs_train::scenes::{Scene, Split, presets};
use lgs_train::stages::checkpoint::{CHECKPOINT_FILE, State, WEIGHTS_FILE};
use lgs_train::stages::clips::{TrainingClip, find};
use lgs_train::stages::sample::sample;
use lgs_train::stages::schedule::Schedule;
use lgs_train::stages::settings::Settings;
use lgs_train::stages::train::{Job, Observer, StepReport, train};
use lgs_train::stages::validate::{Score, ValidationClip};
use libtest_mimic::{Failed, Trial};

const FRAMES: usize = 4;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("train::backbone::a_run_that_was_interrupted_ends_with_the_same_bits", same_bits_after_resume),
        case("train::backbone::threads_do_not_matter", threads_do_not_matter),
        case("train::backbone::held_out_frames_are_never_read", held_out_frames_are_never_read),
        case("train::backbone::clips_of_validation_are_not_trained_on", overlap_is_refused),
        case("train::backbone::a_step_that_is_not_finite_changes_nothing", not_finite),
        case("train::backbone::the_loss_falls", the_loss_falls),
    ]
}

fn failed(error: impl std::fmt::Display) -> Failed {
    error.to_string().into()
}

fn config() -> ModelConfig {
    let unet = UNetConfig { stem: 8, encoder: vec![8], decoder: vec![34] };
    ModelConfig {
        format: MODEL_FORMAT.to_owned(),
        name: "test".to_owned(),
        voxel_size: 0.4,
        background_voxel_size: 1.0,
        unet: unet.clone(),
        background_unet: unet,
        query: Some(QueryConfig { neighbours: 4 }),
        policy: None,
    }
}

fn settings(steps: u64) -> Settings {
    Settings {
        seed: 5,
        schedule: Schedule { steps, warm_up: 1, peak: 2e-3 },
        calibration: 2,
        weight_decay: 0.01,
        max_gradient: 5.0,
        average: 0.9,
        crop: [24, 40],
        max_views: 3,
        refine_steps: 2,
        target_share: 0.5,
        perturbed: 0.5,
    }
}

/// Writes a small clip as `root/name`.
fn clip(root: &Path, name: &str, seed: u64) -> Result<PathBuf, Failed> {
    let mut config = presets::street_clip(seed);
    config.num_frames = FRAMES;
    for camera in &mut config.rig.cameras {
        (camera.height, camera.width) = (32, 48);
    }
    (config.rig.lidar.num_beams, config.rig.lidar.num_azimuths) = (16, 60);
    let export = Export { name: name.to_owned(), images: ImageFormat::Png, masks: false };
    let dir = root.join(name);
    write(&Scene::new(config).map_err(failed)?, &dir, &export, &|| ()).map_err(failed)?;
    Ok(dir)
}

/// Directory of two clips.
fn clips(root: &Path) -> Result<PathBuf, Failed> {
    let dir = root.join("clips");
    for (name, number) in [("a", 1), ("b", 2)] {
        clip(&dir, name, Split::Train.seed(number))?;
    }
    Ok(dir)
}

fn open(dir: &Path, hold_out: &HoldOut) -> Result<Vec<TrainingClip>, Failed> {
    let dirs = find(dir).map_err(failed)?;
    dirs.iter().map(|dir| TrainingClip::open(dir, hold_out)).collect::<Result<_, _>>().map_err(failed)
}

fn job(clips: &Path, out: &Path) -> Result<Job, Failed> {
    Ok(Job {
        clips: open(clips, &HoldOut::Nothing)?,
        validation: Vec::new(),
        out: out.to_owned(),
        checkpoint_every: 3,
        validate_every: 3,
    })
}

struct Silent;

impl Observer for Silent {
    fn step(&self, _: u64, _: &StepReport) {}
    fn validated(&self, _: u64, _: &Score) {}
}

fn bytes(dir: &Path) -> Result<[Vec<u8>; 2], Failed> {
    Ok([std::fs::read(dir.join(CHECKPOINT_FILE))?, std::fs::read(dir.join(WEIGHTS_FILE))?])
}

fn same_bits_after_resume() -> Outcome {
    let place = tempfile::tempdir()?;
    let clips = clips(place.path())?;
    let at_once = place.path().join("at_once");
    let mut state = State::new(&config(), settings(6)).map_err(failed)?;
    train(&mut state, &job(&clips, &at_once)?, &Silent).map_err(failed)?;

    let in_two = place.path().join("in_two");
    let mut state = State::new(&config(), settings(6)).map_err(failed)?;
    let interrupted = StopAt { step: 3, dir: in_two.clone(), copy: place.path().join("copy") };
    train(&mut state, &job(&clips, &in_two)?, &interrupted).map_err(failed)?;
    let mut state = State::read(&interrupted.copy).map_err(failed)?;
    if state.step != 3 {
        return Err(format!("expected the checkpoint of step 3, found {}", state.step).into());
    }
    let resumed = interrupted.copy.clone();
    train(&mut state, &job(&clips, &resumed)?, &Silent).map_err(failed)?;
    if bytes(&at_once)? != bytes(&resumed)? {
        return Err("the resumed run ended with other bits".into());
    }
    load_model(&resumed.join(WEIGHTS_FILE)).map_err(failed)?;
    let rows = std::fs::read_to_string(resumed.join("steps.csv"))?.lines().count();
    if rows == 7 { Ok(()) } else { Err(format!("expected a table of 6 steps, found {rows} lines").into()) }
}

/// Keeps the files that a run has written by a step, as an interruption would leave them.
struct StopAt {
    step: u64,
    dir: PathBuf,
    copy: PathBuf,
}

impl StopAt {
    fn copy(&self) -> std::io::Result<()> {
        std::fs::create_dir_all(&self.copy)?;
        for entry in std::fs::read_dir(&self.dir)? {
            let entry = entry?;
            std::fs::copy(entry.path(), self.copy.join(entry.file_name()))?;
        }
        Ok(())
    }
}

impl Observer for StopAt {
    fn step(&self, step: u64, _: &StepReport) {
        // The files of step 3 are written after its report: the report of step 4 finds them. What is not copied is missed later.
        if step == self.step + 1 {
            let _ = self.copy();
        }
    }

    fn validated(&self, _: u64, _: &Score) {}
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
    for folder in ["images", "lidar"] {
        for entry in std::fs::read_dir(dir.join(folder))? {
            let path = entry?.path();
            let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default().to_owned();
            if name.starts_with("0001") || name.starts_with("0003") {
                let whole = std::fs::read(&path)?;
                // Sizes and headers are looked at when a clip is opened: half an image, and points that are not numbers.
                let spoiled = match folder {
                    "images" => whole[..whole.len() / 2].to_vec(),
                    _ => f32::NAN.to_le_bytes().repeat(whole.len() / 4),
                };
                std::fs::write(&path, spoiled)?;
            }
        }
    }
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
    job.validation = vec![ValidationClip::open(&clips.join("b"), FRAMES, None).map_err(failed)?];
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
    fn step(&self, _: u64, report: &StepReport) {
        let [first, last] = [report.losses.first(), report.losses.last()].map(|l| l.map_or(f64::NAN, |l| l.inputs));
        self.0.borrow_mut().push([first, last]);
    }

    fn validated(&self, _: u64, _: &Score) {}
}

/// After a few steps refinement gains on the views that it is given, of clips and crops that change from step to step.
fn the_loss_falls() -> Outcome {
    let place = tempfile::tempdir()?;
    let clips = clips(place.path())?;
    let mut settings = settings(30);
    settings.schedule.peak = 5e-3;
    let mut state = State::new(&config(), settings).map_err(failed)?;
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
