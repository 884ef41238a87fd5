//! A run: every clip of this share that is not done yet, then the shards.

use std::cell::Cell;
use std::path::PathBuf;
use std::time::Instant;

use lgs_engine::network::model::Model;
use lgs_formats::jobs::{FailedItem, ItemEvent, Items, Part, Tried, part_file, try_items};
use lgs_formats::targets::{ClipCounts, EncodedClip, FailedClip, Manifest, ShardRecord, TARGETS_FORMAT, TargetsConfig};

use super::clips::JobClip;
use super::pack::{Plan, pack};
use super::store::{CLIP_FOLDER, Store};
use crate::error::{Result, TargetError};
use crate::generate::{Seconds, generate, lap, num_passes};
use crate::sample::clip_seed;
use crate::scene::load_scene;

/// A job, or one share of it.
#[derive(Clone, Debug)]
pub struct TargetJob<'a> {
    /// Every clip of the job.
    pub clips: &'a [JobClip],
    /// Which share this is; `None` for all of it.
    pub part: Option<Part>,
    /// Folder to write to.
    pub out: PathBuf,
    /// What decides the values.
    pub config: TargetsConfig,
    /// The network, for the config's weights.
    pub model: Option<&'a Model>,
    /// Most bytes of a shard's data.
    pub shard_bytes: u64,
    /// Whether the folder may hold results of an earlier run of the same job.
    pub resume: bool,
}

/// What happens while a job runs.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// So many clips are to be done; the others of the share are done already.
    Start {
        /// Clips to do.
        todo: usize,
        /// Clips done in earlier runs.
        done: usize,
    },
    /// A clip is done.
    Done {
        /// Its name.
        clip: &'a str,
        /// Primitives of its `LiDAR` branch.
        primitives: usize,
        /// What it took.
        seconds: f64,
    },
    /// A clip failed.
    Failed(&'a FailedItem),
    /// All clips were tried; the shards are being packed.
    Packing,
}

/// What a run did.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// What the folder holds now.
    pub manifest: Manifest,
    /// Clips done in this run.
    pub done_now: usize,
    /// Clips that were done already.
    pub done_before: usize,
    /// Time of the stages, over the clips of this run.
    pub seconds: Seconds,
    /// Rendering passes of this run.
    pub passes: usize,
}

/// Runs a job, or one share of it.
///
/// # Errors
/// A folder that holds something else, and one that cannot be written to: what was done stays, and a later run with `resume` goes on. A
/// clip that fails is no error: the manifest says so.
pub fn run(job: &TargetJob<'_>, tell: &mut dyn FnMut(Event<'_>)) -> Result<Outcome> {
    let clips: Vec<String> = job.clips.iter().map(|clip| clip.name.clone()).collect();
    let items = Items { all: &clips, part: job.part, resume: job.resume };
    let mut store = Store::open(&job.out, &job.config)?;
    let own = items.own();
    if job.resume {
        // A manifest that is there vouches for its shards: they are checked before anything builds on them.
        store.manifest()?;
        if job.part.is_none() {
            store.sweep()?;
        }
    } else {
        store.expect_empty(&own, job.part)?;
    }
    let (mut seconds, mut passes) = (Seconds::default(), 0);
    // Primitives of the clip that was made last, and seconds so far.
    let last = Cell::new((0, 0.0));
    let mut make = |name: &str| {
        let clip = job.clips.iter().find(|clip| clip.name == name).ok_or_else(|| unknown(name))?;
        let (encoded, views) = one(job, clip, &mut seconds)?;
        passes += num_passes(&job.config, views);
        last.set((encoded.dims.primitives, seconds.total()));
        Ok::<_, TargetError>(encoded)
    };
    let told = &mut |event: ItemEvent<'_>| match event {
        ItemEvent::Start { todo, done } => tell(Event::Start { todo, done }),
        ItemEvent::Done(clip) => {
            let (primitives, seconds) = last.get();
            tell(Event::Done { clip, primitives, seconds });
        }
        ItemEvent::Failed(failed) => tell(Event::Failed(failed)),
    };
    let Tried { done_now, done_before, failed } = try_items(&mut store, &items, &mut make, told)?;
    let failed: Vec<FailedClip> =
        failed.into_iter().map(|FailedItem { item: clip, reason }| FailedClip { clip, reason }).collect();
    seconds.write += store.write_s;
    tell(Event::Packing);
    let mut clock = Instant::now();
    let plan = Plan { config: &job.config, clips: &clips, failed: &failed, shard_bytes: job.shard_bytes };
    let manifest = match job.part {
        None => pack(&mut store, &plan)?,
        Some(part) => finish_part(&store, &plan, &own, part)?,
    };
    lap(&mut clock, &mut seconds.write);
    Ok(Outcome { manifest, done_now, done_before, seconds, passes })
}

fn unknown(name: &str) -> TargetError {
    TargetError::unfit("CLIPS", "a clip of the job", name)
}

/// The targets of one clip and the number of its views.
fn one(job: &TargetJob<'_>, clip: &JobClip, seconds: &mut Seconds) -> Result<(EncodedClip, usize)> {
    let mut clock = Instant::now();
    let scene = load_scene(&clip.path, &job.config, job.model)?;
    lap(&mut clock, &mut seconds.scene);
    let views = scene.views.len();
    let targets = generate(scene, &job.config, clip_seed(job.config.seed, &clip.name), seconds)?;
    let mut clock = Instant::now();
    let encoded = EncodedClip::new(&clip.path, &targets)?;
    lap(&mut clock, &mut seconds.write);
    Ok((encoded, views))
}

/// The manifest of a share: its clips stay shards of their own until the shares are merged.
fn finish_part(store: &Store, plan: &Plan<'_>, own: &[&str], part: Part) -> Result<Manifest> {
    let mut shards = Vec::new();
    for &clip in own.iter().filter(|clip| !plan.failed.iter().any(|failed| failed.clip == **clip)) {
        let Some(encoded) = store.clip(clip)? else {
            let found = "shards that were packed already: the parts are merged".to_owned();
            return Err(TargetError::unfit("part", "a folder whose parts are not merged yet", found));
        };
        let record = ClipCounts {
            clip: clip.to_owned(),
            primitives: encoded.dims.primitives,
            sampled: encoded.dims.sampled,
            valid_prune: encoded.num_valid[0],
            valid_add: encoded.num_valid[1],
        };
        shards.push(ShardRecord::of(&store.folder, format!("{CLIP_FOLDER}/{clip}.safetensors"), vec![record])?);
    }
    let manifest = Manifest {
        format: TARGETS_FORMAT.to_owned(),
        part: Some(part),
        config: plan.config.clone(),
        clips: plan.clips.to_vec(),
        shards,
        failed: plan.failed.to_vec(),
    };
    manifest.write(&store.folder.join(part_file(part)))?;
    Ok(manifest)
}
