//! Training targets of the densify policy: shards of clips and the manifest beside them, as `FORMAT.md` in this folder specifies.

use std::collections::BTreeMap;

mod config;
mod layout;
mod manifest;
mod shard;
#[cfg(test)]
mod tests;
mod write;

pub use config::{Normalise, Signal, TargetsConfig, ZScore};
pub use layout::{ClipDims, MAX_CLIP_NAME, is_clip_name};
pub use manifest::{ClipCounts, FailedClip, MANIFEST_FILE, Manifest, ShardRecord, TARGETS_FORMAT, shard_file};
pub use shard::Shard;
pub use write::{EncodedClip, WrittenShard, write_shard};

/// Attributes of one Gaussian.
pub const NUM_ATTRIBUTES: usize = 14;

/// Targets of one action.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ActionTargets {
    /// `[M]` what a score has to be, 0..=1: above 0.5 where the action helps; 0.5 where the mask is not set.
    pub y: Vec<f32>,
    /// `[M]` change that the action made, before any transform; negative where it helps, 0 where the mask is not set.
    pub delta: Vec<f32>,
    /// `[M]` whether there is a target.
    pub mask: Vec<bool>,
}

/// Decoder features of every primitive.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct HalfFeatures {
    /// Features of a primitive.
    pub width: usize,
    /// `[N, width]` bits of IEEE binary16.
    pub bits: Vec<u16>,
}

/// The targets of one clip.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClipTargets {
    /// `[M]` the sampled primitives, ascending.
    pub index: Vec<u32>,
    /// `[M]` rounds in which each was sampled, at least 1.
    pub samples: Vec<u8>,
    /// Of taking the primitive out.
    pub prune: ActionTargets,
    /// Of a copy beside it.
    pub add: ActionTargets,
    /// Mean and standard deviation of the transformed deltas that prune and add were scored against.
    pub moments: [[f64; 2]; 2],
    /// `[N, 14]` raw attributes of the `LiDAR` branch.
    pub gaussians: Vec<[f32; NUM_ATTRIBUTES]>,
    /// `[N]` seconds.
    pub times: Vec<f32>,
    /// `[N]` index in the clip of the frame that each comes from; `None` in shards of programs that did not keep them.
    pub frames: Option<Vec<u32>>,
    /// `[N, 3]` metres a second.
    pub velocities: Vec<[f32; 3]>,
    /// Decoder features, when they were asked for.
    pub features: Option<HalfFeatures>,
}

impl ClipTargets {
    /// `[N]` for each primitive the place of its time among the different ones, by first appearance: its frame where sweeps have one time each.
    pub fn frames_of_times(&self) -> Vec<u32> {
        let mut places = BTreeMap::new();
        let place = |time: &f32| {
            let next = u32::try_from(places.len()).unwrap_or(u32::MAX);
            *places.entry(time.to_bits()).or_insert(next)
        };
        self.times.iter().map(place).collect()
    }

    /// The lengths of the clip's tensors.
    pub fn dims(&self) -> ClipDims {
        ClipDims {
            sampled: self.index.len(),
            primitives: self.gaussians.len(),
            frames: self.frames.is_some(),
            features: self.features.as_ref().map(|features| features.width),
        }
    }
}
