//! A very small model, very small clips, and somebody who stops a run.

use std::path::{Path, PathBuf};

use lgs_engine::network::config::{Guidance, MODEL_FORMAT, ModelConfig, QueryConfig, StepLength};
use lgs_engine::network::policy::{Cycle, PolicyConfig, StageConfig};
use lgs_engine::network::unet::UNetConfig;
use lgs_engine::ops::serialization::Curve;
use lgs_engine::pipeline::HoldOut;
use lgs_train::scenes::export::{Export, ImageFormat, write};
use lgs_train::scenes::{Scene, Split, presets};
use lgs_train::stages::checkpoint::{CHECKPOINT_FILE, State, WEIGHTS_FILE};
use lgs_train::stages::clips::{TrainingClip, find};
use lgs_train::stages::rendering::Rendering;
use lgs_train::stages::schedule::Schedule;
use lgs_train::stages::settings::{RunSettings, Settings};
use lgs_train::stages::task::Task;
use lgs_train::stages::train::{Job, Observer, StepReport, train};
use libtest_mimic::Failed;

/// Frames of a clip.
pub(crate) const FRAMES: usize = 4;

pub(crate) fn failed(error: impl std::fmt::Display) -> Failed {
    error.to_string().into()
}

pub(crate) fn config() -> ModelConfig {
    let unet = UNetConfig { stem: 8, encoder: vec![8], decoder: vec![34] };
    ModelConfig {
        format: MODEL_FORMAT.to_owned(),
        name: "test".to_owned(),
        voxel_size: 0.4,
        background_voxel_size: 1.0,
        guidance: Guidance::default(),
        step_length: StepLength::default(),
        head_width: None,
        unet: unet.clone(),
        background_unet: unet,
        query: Some(QueryConfig { neighbours: 4 }),
        policy: None,
    }
}

/// [`config`] with a policy.
pub(crate) fn config_with_policy() -> ModelConfig {
    let stage = |channels| StageConfig { channels, heads: 2, blocks: 1 };
    let policy = PolicyConfig {
        encoder: vec![stage(8), stage(12)],
        decoder: vec![stage(8)],
        patch: 16,
        mlp_ratio: 2,
        curves: vec![Curve::Z, Curve::Hilbert],
        cycle: Cycle::Continue,
        head_blocks: 1,
        head_width: 8,
    };
    ModelConfig { policy: Some(policy), ..config() }
}

pub(crate) fn settings(steps: u64) -> Settings {
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
        pruned: 0.3,
        mirrored: 0.5,
        velocity: 0.02,
        psnr: 0.0,
        noise: 0.05,
        thresholds: None,
        max_gaussians: None,
    }
}

/// Writes a small clip as `root/name`.
pub(crate) fn clip(root: &Path, name: &str, seed: u64) -> Result<PathBuf, Failed> {
    let mut config = presets::street_clip(seed);
    config.num_frames = FRAMES;
    for camera in &mut config.rig.cameras {
        (camera.height, camera.width) = (32, 48);
    }
    (config.rig.lidar.num_beams, config.rig.lidar.num_azimuths) = (16, 60);
    let export = Export { name: name.to_owned(), images: ImageFormat::Png, masks: false, depth: None };
    let dir = root.join(name);
    write(&Scene::new(config).map_err(failed)?, &dir, &export, &|| ()).map_err(failed)?;
    Ok(dir)
}

/// Directory of two clips.
pub(crate) fn clips(root: &Path) -> Result<PathBuf, Failed> {
    let dir = root.join("clips");
    for (name, number) in [("a", 1), ("b", 2)] {
        clip(&dir, name, Split::Train.seed(number))?;
    }
    Ok(dir)
}

pub(crate) fn open(dir: &Path, hold_out: &HoldOut) -> Result<Vec<TrainingClip>, Failed> {
    let dirs = find(dir).map_err(failed)?;
    dirs.iter().map(|dir| TrainingClip::open(dir, hold_out)).collect::<Result<_, _>>().map_err(failed)
}

pub(crate) fn job(clips: &Path, out: &Path) -> Result<Job<Rendering>, Failed> {
    let clips = open(clips, &HoldOut::Nothing)?;
    Ok(Job {
        task: Rendering { clips, validation: Vec::new(), policy: None },
        out: out.to_owned(),
        checkpoint_every: 3,
        validate_every: 3,
    })
}

/// Hears nothing.
pub(crate) struct Silent;

impl Observer for Silent {
    fn step(&self, _: u64, _: &StepReport<'_>) {}
    fn validated(&self, _: u64, _: &str) {}
}

pub(crate) fn bytes(dir: &Path) -> Result<[Vec<u8>; 2], Failed> {
    Ok([std::fs::read(dir.join(CHECKPOINT_FILE))?, std::fs::read(dir.join(WEIGHTS_FILE))?])
}

/// How a run ends, undisturbed and resumed.
pub(crate) struct Ends {
    /// Checkpoint and weights of the undisturbed run.
    pub(crate) whole: [Vec<u8>; 2],
    /// Of the other.
    pub(crate) resumed: [Vec<u8>; 2],
    /// Folder of the other.
    pub(crate) folder: PathBuf,
}

/// Runs a stage at once, and another time interrupted after step 3 and resumed.
pub(crate) fn whole_and_resumed<T: Task>(
    place: &Path,
    start: impl Fn() -> Result<State<T::Settings>, Failed>,
    job: impl Fn(&Path) -> Result<Job<T>, Failed>,
) -> Result<Ends, Failed> {
    let at_once = place.join("at_once");
    train(&mut start()?, &job(&at_once)?, &Silent).map_err(failed)?;
    let in_two = place.join("in_two");
    let mut state = start()?;
    let stage = state.settings.stage();
    let interrupted = StopAt { step: 3, dir: in_two.clone(), copy: place.join("copy") };
    train(&mut state, &job(&in_two)?, &interrupted).map_err(failed)?;
    let mut state = State::read(&interrupted.copy, stage).map_err(failed)?;
    if state.step != 3 {
        return Err(format!("expected the checkpoint of step 3, found {}", state.step).into());
    }
    train(&mut state, &job(&interrupted.copy)?, &Silent).map_err(failed)?;
    Ok(Ends { whole: bytes(&at_once)?, resumed: bytes(&interrupted.copy)?, folder: interrupted.copy })
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
    fn step(&self, step: u64, _: &StepReport<'_>) {
        // The files of step 3 are written after its report: the report of step 4 finds them. What is not copied is missed later.
        if step == self.step + 1 {
            let _ = self.copy();
        }
    }

    fn validated(&self, _: u64, _: &str) {}
}

/// Spoils images and sweeps of the odd frames of a clip; their sizes and headers stay.
pub(crate) fn spoil_odd_frames(clip: &Path) -> Result<(), Failed> {
    for folder in ["images", "lidar"] {
        for entry in std::fs::read_dir(clip.join(folder))? {
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
    Ok(())
}
