//! Stage 2 on a very small model: shards that are learnt, refused, held out; features from shards and from clips.

use std::path::{Path, PathBuf};

use lgs_engine::network::config::ModelConfig;
use lgs_engine::network::source::load_model;
use lgs_formats::targets::{
    ActionTargets, ClipCounts, ClipTargets, EncodedClip, HalfFeatures, MANIFEST_FILE, Manifest, ShardRecord, Signal,
    TARGETS_FORMAT, TargetsConfig, shard_file, write_shard,
};
use lgs_targetgen::job::find_clips;
use lgs_tests::{Outcome, case, clips as shipped};
use lgs_train::stages::checkpoint::State;
use lgs_train::stages::policy::{PolicyTask, Recompute, ShardClips, ShardOptions};
use lgs_train::stages::schedule::Schedule;
use lgs_train::stages::settings::{Optimisation, PolicySettings};
use lgs_train::stages::train::{Job, Observer, StepReport, train};
use lgs_train::stages::variables::Variables;
use lgs_train::stages::weights::{Precision, StartWeights, write_weights};
use libtest_mimic::{Failed, Trial};

use super::fixtures::{Ends, Silent, config_with_policy, failed, whole_and_resumed};
use crate::targetgen::job::{SMALL, targetgen};

/// What stands for the digest of weights.
const WEIGHTS: &str = "abc";
/// Primitives of a clip.
const N: usize = 400;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("train::policy::one_shard_can_be_learnt", one_shard_can_be_learnt),
        case("train::policy::a_run_that_was_interrupted_ends_with_the_same_bits", same_bits_after_resume),
        case("train::policy::targets_of_other_weights_are_refused", other_weights_are_refused),
        case("train::policy::signals_are_not_mixed", signals_are_not_mixed),
        case("train::policy::what_is_held_out_is_not_learnt", held_out_is_not_learnt),
        case("train::policy::features_may_come_from_the_clip", features_from_the_clip),
    ]
}

fn targets_config(signal: Signal) -> TargetsConfig {
    TargetsConfig { signal, with_features: true, weights: Some(WEIGHTS.to_owned()), ..TargetsConfig::default() }
}

/// Repeatable values in -1..1.
fn value(k: usize) -> f32 {
    ((k * 7919 + 104_729) % 10_007) as f32 / 5003.0 - 1.0
}

/// Half of the primitives have targets, which their first feature tells; `sign` turns them round.
fn clip(number: usize, width: usize, sign: f32) -> ClipTargets {
    let feature = |i: usize, k: usize| {
        let v = value((number * N + i) * width + k);
        if k == 0 { v.signum() } else { v }
    };
    let index: Vec<u32> = (0_u32..).step_by(2).take(N / 2).collect();
    let rows = index.len();
    let targets = |sign: f32| ActionTargets {
        y: index.iter().map(|&i| 0.5 + 0.4 * sign * feature(i as usize, 0)).collect(),
        delta: vec![0.0; rows],
        mask: vec![true; rows],
    };
    // Every primitive has a voxel of its own.
    let place = |i: usize| [i % 8, i / 8 % 8, i / 64].map(|step| 0.9 * step as f32 - 3.0);
    let row = |i: usize| std::array::from_fn(|k| if k < 3 { place(i)[k] } else { value(14 * i + k) });
    let half = |v: f32| half::f16::from_f32(v).to_bits();
    ClipTargets {
        samples: vec![1; rows],
        prune: targets(sign),
        add: targets(-sign),
        index,
        moments: [[0.0, 1.0]; 2],
        gaussians: (0..N).map(row).collect(),
        times: (0..N).map(|i| (i % 3) as f32 * 0.1).collect(),
        frames: None,
        velocities: vec![[0.0; 3]; N],
        features: Some(HalfFeatures {
            width,
            bits: (0..N * width).map(|j| half(feature(j / width, j % width))).collect(),
        }),
    }
}

/// A folder with one shard of clips.
fn shards(folder: &Path, config: &TargetsConfig, clips: &[ClipTargets]) -> Outcome {
    std::fs::create_dir_all(folder)?;
    let file = shard_file(0);
    let path = folder.join(&file);
    let names: Vec<String> = (0..clips.len()).map(|k| format!("clip-{k}")).collect();
    let encoded: Vec<EncodedClip> =
        clips.iter().map(|clip| EncodedClip::new(&path, clip)).collect::<Result<_, _>>().map_err(failed)?;
    let listed: Vec<_> = names.iter().map(String::as_str).zip(encoded.iter().map(|clip| clip.dims)).collect();
    write_shard(&path, config, &listed, |k| Ok(encoded[k].clone())).map_err(failed)?;
    let record = |(name, clip): (&String, &EncodedClip)| ClipCounts {
        clip: name.clone(),
        primitives: clip.dims.primitives,
        sampled: clip.dims.sampled,
        valid_prune: clip.num_valid[0],
        valid_add: clip.num_valid[1],
    };
    let records = names.iter().zip(&encoded).map(record).collect();
    let manifest = Manifest {
        format: TARGETS_FORMAT.to_owned(),
        part: None,
        config: config.clone(),
        clips: names.clone(),
        shards: vec![ShardRecord::of(folder, file, records).map_err(failed)?],
        failed: Vec::new(),
    };
    manifest.write(&folder.join(MANIFEST_FILE)).map_err(failed)
}

fn settings(steps: u64) -> PolicySettings {
    let optimisation = Optimisation {
        seed: 3,
        schedule: Schedule { steps, warm_up: 1, peak: 1e-2 },
        calibration: 2,
        weight_decay: 0.0,
        max_gradient: 5.0,
        average: 0.9,
    };
    PolicySettings { optimisation, gamma: 2.0, max_primitives: 300 }
}

fn open(folders: &[PathBuf], config: &ModelConfig, hold_out_every: usize) -> Result<ShardClips, Failed> {
    let options = ShardOptions { weights: WEIGHTS, config, hold_out_every, recompute: None };
    ShardClips::open(folders, options).map_err(failed)
}

fn job(folder: &Path, hold_out_every: usize, out: &Path) -> Result<Job<PolicyTask>, Failed> {
    let config = config_with_policy();
    let task = PolicyTask::new(open(&[folder.to_owned()], &config, hold_out_every)?, 4, &config).map_err(failed)?;
    Ok(Job { task, out: out.to_owned(), checkpoint_every: 3, validate_every: 1000 })
}

fn start(steps: u64) -> Result<State<PolicySettings>, Failed> {
    State::new(&config_with_policy(), settings(steps)).map_err(failed)
}

fn width() -> usize {
    config_with_policy().unet.width()
}

#[derive(Default)]
struct Watch {
    losses: std::cell::RefCell<Vec<f64>>,
}

impl Observer for Watch {
    fn step(&self, _: u64, report: &StepReport<'_>) {
        self.losses.borrow_mut().extend(report.value("loss"));
    }

    fn validated(&self, _: u64, _: &str) {}
}

fn one_shard_can_be_learnt() -> Outcome {
    let place = tempfile::tempdir()?;
    let folder = place.path().join("shards");
    shards(&folder, &targets_config(Signal::Response), &[clip(0, width(), 1.0), clip(1, width(), 1.0)])?;
    let mut state = start(150)?;
    let before = state.variables.values().map_err(failed)?;
    let watch = Watch::default();
    train(&mut state, &job(&folder, 0, &place.path().join("out"))?, &watch).map_err(failed)?;
    let losses = watch.losses.borrow();
    let mean = |losses: &[f64]| losses.iter().sum::<f64>() / losses.len() as f64;
    let (first, last) = (mean(&losses[..4]), mean(&losses[140..]));
    // Scores of 1/2, where an untrained policy is: (0.4)^2 for each action.
    if (first - 0.32).abs() > 1e-4 || last > 0.3 * first {
        return Err(format!("the loss is {first} at first and {last} in the end").into());
    }
    let after = state.variables.values().map_err(failed)?;
    for (spec, (before, after)) in state.variables.specs().iter().zip(before.iter().zip(&after)) {
        if !spec.name.starts_with("policy.") && before != after {
            return Err(format!("{} is not of the policy, yet it moved", spec.name).into());
        }
    }
    Ok(())
}

fn same_bits_after_resume() -> Outcome {
    let place = tempfile::tempdir()?;
    let folder = place.path().join("shards");
    shards(&folder, &targets_config(Signal::Footprint), &[0, 1, 2].map(|k| clip(k, width(), 1.0)))?;
    let Ends { whole, resumed, .. } = whole_and_resumed(place.path(), || start(6), |out| job(&folder, 0, out))?;
    if whole == resumed { Ok(()) } else { Err("the resumed run ended with other bits".into()) }
}

/// Fails unless opening says `expected`, in one line.
fn refused(folders: &[PathBuf], expected: &str) -> Outcome {
    match open(folders, &config_with_policy(), 0) {
        Ok(_) => Err("expected a refusal".into()),
        Err(error) => {
            let text = error.message().unwrap_or_default();
            if text.contains(expected) && text.lines().count() == 1 { Ok(()) } else { Err(text.into()) }
        }
    }
}

fn other_weights_are_refused() -> Outcome {
    let place = tempfile::tempdir()?;
    for (weights, found) in [(Some("def".to_owned()), "def"), (None, "none")] {
        let folder = place.path().join(found);
        let config = TargetsConfig { weights, ..targets_config(Signal::Response) };
        shards(&folder, &config, &[clip(0, width(), 1.0)])?;
        let line = format!("manifest.json: config.weights: expected abc (the SHA-256 of the weights), found {found}");
        refused(&[folder], &line)?;
    }
    Ok(())
}

fn signals_are_not_mixed() -> Outcome {
    let place = tempfile::tempdir()?;
    let folders =
        [Signal::Response, Signal::Magnitude].map(|signal| (place.path().join(format!("{signal:?}")), signal));
    for (folder, signal) in &folders {
        shards(folder, &targets_config(*signal), &[clip(0, width(), 1.0)])?;
    }
    refused(&folders.map(|(folder, _)| folder), "config.signal: expected Response, as before, found Magnitude")
}

/// Turns round the targets of the clip that is held out: the weights are the same bits, what is measured is not.
fn held_out_is_not_learnt() -> Outcome {
    let place = tempfile::tempdir()?;
    let mut found = Vec::new();
    for (name, signs) in [("a", [1.0, 1.0]), ("b", [1.0, -1.0]), ("c", [-1.0, 1.0])] {
        let (folder, out) = (place.path().join(name), place.path().join(format!("{name}-out")));
        let clips = [0, 1].map(|k| clip(k, width(), signs[k]));
        shards(&folder, &targets_config(Signal::Response), &clips)?;
        let mut state = start(8)?;
        train(&mut state, &job(&folder, 2, &out)?, &Silent).map_err(failed)?;
        found.push((state.variables.values().map_err(failed)?, std::fs::read_to_string(out.join("validation.csv"))?));
    }
    if found[0].0 != found[1].0 || found[0].1 == found[1].1 {
        return Err("the weights depend on what is held out, or it is not measured on".into());
    }
    if found[0].0 == found[2].0 { Err("the weights do not depend on the targets".into()) } else { Ok(()) }
}

/// Shards with and without features of one clip: what the policy reads is the same; without the clip it is refused.
fn features_from_the_clip() -> Outcome {
    let place = tempfile::tempdir()?;
    let weights = place.path().join("weights");
    let config = config_with_policy();
    write_weights(&Variables::seeded(&config, 6).map_err(failed)?, Precision::Full, &weights).map_err(failed)?;
    std::fs::write(place.path().join("list"), format!("{0}\n{0}\n", shipped::street().display()))?;
    for more in [["--out", "stored", "--with-features"].as_slice(), &["--out", "bare"]] {
        let arguments = [&["list", "--weights", "weights"], SMALL.as_slice(), more].concat();
        targetgen(place.path(), &arguments)?.expect_success()?;
    }
    let digest = StartWeights::read(&weights).map_err(failed)?.sha256;
    let held_out = |folder: &str, clips: &[PathBuf], always: bool| -> Result<_, Failed> {
        let recompute = match clips {
            [] => None,
            clips => {
                let (model, clips) = (load_model(&weights).map_err(failed)?.model, find_clips(clips).map_err(failed)?);
                Some(Recompute { model, clips, always })
            }
        };
        let options = ShardOptions { weights: &digest, config: &config, hold_out_every: 2, recompute };
        ShardClips::open(&[place.path().join(folder)], options).map_err(failed)?.held_out(9).map_err(failed)
    };
    let list = [place.path().join("list")];
    let stored = held_out("stored", &[], false)?;
    let found = [held_out("stored", &list, false)?, held_out("stored", &list, true)?, held_out("bare", &list, false)?];
    if stored.len() != 1 || found.iter().any(|clips| *clips != stored) {
        return Err("features from the clip differ from those of the shard".into());
    }
    match held_out("bare", &[], false) {
        Err(error) if error.message().is_some_and(|text| text.contains("features in the shard, or the clip")) => Ok(()),
        other => Err(format!("expected a refusal, found {other:?}").into()),
    }
}
