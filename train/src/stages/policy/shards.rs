//! Clips of shards: which are trained on, which are held out, and their content with the features that the policy reads.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};

use half::f16;
use lgs_engine::{
    gaussians::GaussianSet,
    network::{config::ModelConfig, model::Model},
};
use lgs_formats::{
    error::FormatError,
    targets::{ClipTargets, HalfFeatures, MANIFEST_FILE, Manifest, Shard, Signal, TargetsConfig},
};
use lgs_targetgen::{job::JobClip, scene::load_scene};

use crate::{
    error::{Result, TrainError},
    scenes::rng::Rng,
};

/// Where the draws of an epoch's order stand, beyond those of all steps.
const EPOCHS: u64 = 1 << 63;

/// Where features come from that shards do not hold.
#[derive(Debug)]
pub struct Recompute {
    /// The network.
    pub model: Model,
    /// The clips of the shards.
    pub clips: Vec<JobClip>,
    /// Whether it also replaces features that a shard holds, which may then be of other weights.
    pub always: bool,
}

/// What is taken from shards, and how.
#[derive(Debug)]
pub struct ShardOptions<'a> {
    /// SHA-256 of the weights that the targets must have been made with.
    pub weights: &'a str,
    /// Sizes of the model.
    pub config: &'a ModelConfig,
    /// Every so many clips one is held out; 0 for none.
    pub hold_out_every: usize,
    /// Where features come from that shards do not hold.
    pub recompute: Option<Recompute>,
}

/// The clips of some folders of shards.
#[derive(Debug)]
pub struct ShardClips {
    files: Vec<ShardFile>,
    held_out: Vec<(PathBuf, String)>,
    config: TargetsConfig,
    width: usize,
    recompute: Option<(Model, BTreeMap<String, PathBuf>, bool)>,
    /// The shard that was read last: the clips of a shard follow each other.
    last: Mutex<Option<(PathBuf, Arc<Shard>)>>,
}

/// A shard and the names of its clips that are trained on.
#[derive(Debug)]
struct ShardFile {
    path: PathBuf,
    clips: Vec<String>,
}

/// A clip with everything that the policy reads.
#[derive(Clone, Debug, PartialEq)]
pub struct PolicyClip {
    /// Its targets.
    pub targets: ClipTargets,
    /// The `LiDAR` branch as predicted.
    pub set: GaussianSet,
    /// `[N, width]`.
    pub features: Vec<f32>,
}

impl ShardClips {
    /// The clips of folders with manifests.
    ///
    /// # Errors
    /// A folder without a valid manifest; targets of other weights, or of different signals; nothing to train on.
    pub fn open(folders: &[PathBuf], options: ShardOptions<'_>) -> Result<Self> {
        let ShardOptions { weights, config: model, hold_out_every, recompute } = options;
        let (mut files, mut held_out, mut first): (Vec<ShardFile>, Vec<_>, Option<TargetsConfig>) = Default::default();
        let mut num_clips = 0_usize;
        for folder in folders {
            let path = folder.join(MANIFEST_FILE);
            let manifest = Manifest::read(&path)?;
            check(&path, &manifest.config, weights, recompute.as_ref().is_some_and(|r| r.always))?;
            check_signal(&path, &manifest.config, first.as_ref().map(|c| c.signal))?;
            for shard in &manifest.shards {
                let (path, mut clips) = (folder.join(&shard.file), Vec::new());
                for record in &shard.clips {
                    num_clips += 1;
                    if hold_out_every > 0 && num_clips.is_multiple_of(hold_out_every) {
                        held_out.push((path.clone(), record.clip.clone()));
                    } else {
                        clips.push(record.clip.clone());
                    }
                }
                files.push(ShardFile { path, clips });
            }
            first.get_or_insert(manifest.config);
        }
        let trained = || files.iter().flat_map(|file| file.clips.iter());
        if let Some((_, name)) = held_out.iter().find(|(_, name)| trained().any(|other| other == name)) {
            return Err(TrainError::config("shards", "each clip once, as some are held out", name));
        }
        let Some(config) = first.filter(|_| trained().next().is_some()) else {
            return Err(TrainError::config("shards", "at least one clip to train on", num_clips));
        };
        let recompute = recompute.map(|Recompute { model, clips, always }| {
            (model, clips.into_iter().map(|clip| (clip.name, clip.path)).collect(), always)
        });
        files.retain(|file| !file.clips.is_empty());
        Ok(Self { files, held_out, config, width: model.unet.width(), recompute, last: Mutex::new(None) })
    }

    /// What decided the targets.
    pub fn config(&self) -> &TargetsConfig {
        &self.config
    }

    /// The clip that a step trains on: each once in an epoch, those of a shard after each other, shards and clips in the order of a draw.
    ///
    /// # Errors
    /// Whatever is wrong with the shard.
    pub(crate) fn draw(&self, seed: u64, step: u64) -> Result<PolicyClip> {
        let total = self.files.iter().map(|file| file.clips.len() as u64).sum::<u64>().max(1);
        let mut rng = Rng::new(seed, EPOCHS | (step / total));
        let mut at = usize::try_from(step % total).unwrap_or_default();
        for file in shuffled(self.files.iter().collect(), &mut rng) {
            let names = shuffled(file.clips.iter().collect(), &mut rng);
            match names.get(at) {
                Some(name) => return self.read(&file.path, name),
                None => at -= names.len(),
            }
        }
        Err(TrainError::config("shards", "at least one clip to train on", 0))
    }

    /// The clips that are held out, at most `most` of them.
    ///
    /// # Errors
    /// Whatever is wrong with a shard.
    pub fn held_out(&self, most: usize) -> Result<Vec<PolicyClip>> {
        self.held_out.iter().take(most).map(|(path, name)| self.read(path, name)).collect()
    }

    fn read(&self, path: &Path, name: &str) -> Result<PolicyClip> {
        let mut targets = self.shard(path)?.clip(name)?;
        let n = targets.gaussians.len();
        let set = GaussianSet {
            frames: targets.frames.take().unwrap_or_else(|| targets.frames_of_times()),
            attributes: std::mem::take(&mut targets.gaussians),
            times: std::mem::take(&mut targets.times),
            velocities: std::mem::take(&mut targets.velocities),
            num_lidar: n,
        };
        let stored = targets.features.take();
        let found = match (stored, &self.recompute) {
            (Some(stored), None | Some((_, _, false))) => Some((set, stored)),
            (_, Some((model, clips, _))) => clips.get(name).map(|clip| self.recomputed(clip, model)).transpose()?,
            (None, None) => None,
        };
        let wrong = |field: &str, expected: String, found: String| FormatError::invalid(path, field, expected, found);
        let Some((set, HalfFeatures { width, bits })) = found else {
            let expected = "features in the shard, or the clip to compute them from".to_owned();
            return Err(wrong(name, expected, "neither".to_owned()).into());
        };
        if width != self.width || bits.len() != n * width {
            let found = format!("{} of {width}", bits.len() / width.max(1));
            return Err(wrong(name, format!("features of {n} primitives, {} each", self.width), found).into());
        }
        let features: Vec<f32> = bits.into_iter().map(|bits| f16::from_bits(bits).to_f32()).collect();
        match features.iter().find(|v| !v.is_finite()) {
            Some(found) => {
                Err(wrong(&format!("{name}/features"), "finite values".to_owned(), found.to_string()).into())
            }
            None => Ok(PolicyClip { targets, set, features }),
        }
    }

    /// The scene of a clip as the network predicts it now; the features pass through the bits that a shard has for them.
    fn recomputed(&self, clip: &Path, model: &Model) -> Result<(GaussianSet, HalfFeatures)> {
        let config = TargetsConfig { with_features: true, ..self.config.clone() };
        let mut scene = load_scene(clip, &config, Some(model))?;
        scene.set.drop_background();
        Ok((scene.set, scene.features.unwrap_or_default()))
    }

    fn shard(&self, path: &Path) -> Result<Arc<Shard>> {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        match &*last {
            Some((at, shard)) if at == path => Ok(shard.clone()),
            _ => {
                let shard = Arc::new(Shard::read(path)?);
                *last = Some((path.to_owned(), shard.clone()));
                Ok(shard)
            }
        }
    }
}

/// # Errors
/// When targets were made with other weights than those that are trained on; with features that are computed anew, any will do.
fn check(path: &Path, config: &TargetsConfig, weights: &str, any: bool) -> Result<()> {
    let found = config.weights.as_deref().unwrap_or("none");
    if any || found == weights {
        return Ok(());
    }
    Err(FormatError::invalid(path, "config.weights", format!("{weights} (the SHA-256 of the weights)"), found).into())
}

fn check_signal(path: &Path, config: &TargetsConfig, first: Option<Signal>) -> Result<()> {
    match first {
        Some(first) if first != config.signal => {
            let (expected, found) = (format!("{first:?}, as before"), format!("{:?}", config.signal));
            Err(FormatError::invalid(path, "config.signal", expected, found).into())
        }
        _ => Ok(()),
    }
}

fn shuffled<T>(mut items: Vec<T>, rng: &mut Rng) -> Vec<T> {
    for i in (1..items.len()).rev() {
        items.swap(i, rng.index(i + 1));
    }
    items
}
