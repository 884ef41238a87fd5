//! `manifest.json`: what a folder of shards holds.

use std::{fs::File, io::Read, path::Path};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::TargetsConfig;
use super::layout::is_clip_name;
use crate::digest::hexadecimal;
use crate::error::{FormatError, Result};
use crate::jobs::{Part, PartManifest};
use crate::read::{MAX_DATA_BYTES, file_size, read_file};
use crate::write::write_atomic;

/// Name of the format, in manifests and shards.
pub const TARGETS_FORMAT: &str = "lgs-targets/1";
/// Name of the manifest of a whole job.
pub const MANIFEST_FILE: &str = "manifest.json";
/// Largest manifest, bytes.
const MAX_MANIFEST_BYTES: u64 = 256 << 20;
/// Bytes that are hashed at a time.
const BLOCK: usize = 1 << 20;

/// File name of a shard by its place.
pub fn shard_file(place: usize) -> String {
    format!("targets-{place:05}.safetensors")
}

/// A clip of a shard.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipCounts {
    /// Its name.
    pub clip: String,
    /// Primitives of the `LiDAR` branch.
    pub primitives: usize,
    /// Primitives that were sampled.
    pub sampled: usize,
    /// Targets for pruning that the mask admits.
    pub valid_prune: usize,
    /// Targets for adding that the mask admits.
    pub valid_add: usize,
}

/// A shard.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShardRecord {
    /// Path of the file, from the manifest's folder.
    pub file: String,
    /// Its size.
    pub bytes: u64,
    /// Its SHA-256, hexadecimal.
    pub sha256: String,
    /// Its clips, in their order.
    pub clips: Vec<ClipCounts>,
}

/// A clip without targets.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FailedClip {
    /// Its name.
    pub clip: String,
    /// Why.
    pub reason: String,
}

/// What a folder of shards holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// [`TARGETS_FORMAT`].
    pub format: String,
    /// Which share of the job this is; `None` for all of it.
    pub part: Option<Part>,
    /// What decided the values.
    pub config: TargetsConfig,
    /// Every clip of the job, in its order: those of all parts, done or failed.
    pub clips: Vec<String>,
    /// The shards, in the order of the clips.
    pub shards: Vec<ShardRecord>,
    /// The clips without targets.
    pub failed: Vec<FailedClip>,
}

impl Manifest {
    /// The manifest of a file.
    ///
    /// # Errors
    /// A file that cannot be read or is not as the format asks.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = read_file(path, MAX_MANIFEST_BYTES)?;
        let mut json = serde_json::Deserializer::from_slice(&bytes);
        let manifest: Self = serde_path_to_error::deserialize(&mut json)
            .map_err(|e| FormatError::syntax(path, e.path().to_string(), e.inner().to_string()))?;
        json.end().map_err(|e| FormatError::syntax(path, "end", e.to_string()))?;
        manifest.check(path)?;
        Ok(manifest)
    }

    fn check(&self, path: &Path) -> Result<()> {
        if self.format != TARGETS_FORMAT {
            return Err(FormatError::invalid(path, "format", TARGETS_FORMAT, self.format.clone()));
        }
        if let Some(part) = self.part.filter(|part| part.index == 0 || part.index > part.count) {
            let found = format!("{} of {}", part.index, part.count);
            return Err(FormatError::invalid(path, "part", "an index from 1 to the count", found));
        }
        let stays = |file: &str| Path::new(file).components().all(|c| matches!(c, std::path::Component::Normal(_)));
        if let Some(shard) = self.shards.iter().find(|shard| shard.file.is_empty() || !stays(&shard.file)) {
            return Err(FormatError::invalid(path, "shards[].file", "a path inside the folder", shard.file.clone()));
        }
        let done = self.shards.iter().flat_map(|shard| &shard.clips).map(|record| &record.clip);
        let named = self.clips.iter().chain(done).chain(self.failed.iter().map(|failed| &failed.clip));
        match named.into_iter().find(|name| !is_clip_name(name)) {
            None => Ok(()),
            Some(name) => Err(FormatError::invalid(path, "clip", "1 to 128 letters, digits and . _ ~ -", name.clone())),
        }
    }

    /// Writes the manifest, atomically.
    ///
    /// # Errors
    /// A path that cannot be written to.
    pub fn write(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self)
            .map_err(|e| FormatError::invalid(path, "manifest", "values that JSON can hold", e.to_string()))?;
        write_atomic(path, (text + "\n").as_bytes())
    }

    /// Fails unless every shard in the manifest's folder has the size and the SHA-256 that the manifest says.
    ///
    /// # Errors
    /// The first shard that has not, by its name.
    pub fn verify(&self, folder: &Path) -> Result<()> {
        self.shards.iter().try_for_each(|shard| shard.verify(folder))
    }
}

impl PartManifest for Manifest {
    fn read(path: &Path) -> Result<Self> {
        Self::read(path)
    }

    fn part(&self) -> Option<Part> {
        self.part
    }

    fn key(&self) -> String {
        serde_json::to_string(&self.config).unwrap_or_default()
    }

    fn items(&self) -> &[String] {
        &self.clips
    }

    fn times_tried(&self, item: &str) -> usize {
        let done = self.shards.iter().flat_map(|shard| &shard.clips).filter(|record| record.clip == item).count();
        done + self.failed.iter().filter(|failed| failed.clip == item).count()
    }
}

impl ShardRecord {
    /// The record of a file that was written just now.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn of(folder: &Path, file: String, clips: Vec<ClipCounts>) -> Result<Self> {
        let path = folder.join(&file);
        Ok(Self { bytes: file_size(&path, MAX_DATA_BYTES)?, sha256: sha256_of(&path)?, file, clips })
    }

    /// Fails unless the file has the size and the SHA-256 that the record says.
    ///
    /// # Errors
    /// When it has not.
    pub fn verify(&self, folder: &Path) -> Result<()> {
        let path = folder.join(&self.file);
        let bytes = file_size(&path, MAX_DATA_BYTES)?;
        if bytes != self.bytes {
            return Err(FormatError::invalid(&path, "size", format!("{} bytes", self.bytes), bytes.to_string()));
        }
        let found = sha256_of(&path)?;
        if found == self.sha256 { Ok(()) } else { Err(FormatError::invalid(&path, "SHA-256", &self.sha256, found)) }
    }
}

fn sha256_of(path: &Path) -> Result<String> {
    let mut file = File::open(path).map_err(|e| FormatError::io(path, "read", e))?;
    let (mut digest, mut block) = (Sha256::new(), vec![0; BLOCK]);
    loop {
        match file.read(&mut block).map_err(|e| FormatError::io(path, "read", e))? {
            0 => return Ok(hexadecimal(&digest.finalize())),
            len => digest.update(&block[..len]),
        }
    }
}
