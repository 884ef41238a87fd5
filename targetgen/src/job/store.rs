//! What a job's folder holds already.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use lgs_formats::error::FormatError;
use lgs_formats::jobs::{ItemStore, Part, part_file, remove_unfinished};
use lgs_formats::targets::{EncodedClip, MANIFEST_FILE, Manifest, Shard, TargetsConfig, WrittenShard, write_shard};

use crate::error::{Result, TargetError};

/// Folder of the shards of one clip each.
pub const CLIP_FOLDER: &str = "clips";

/// A job's folder.
#[derive(Debug)]
pub(super) struct Store {
    pub(super) folder: PathBuf,
    config: TargetsConfig,
    /// Names of the clips of every packed shard that is there, by its place.
    pub(super) shards: BTreeMap<usize, Vec<String>>,
    /// Seconds that it took to keep what was made of clips.
    pub(super) write_s: f64,
}

fn io(path: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> TargetError {
    move |e| FormatError::io(path, action, e).into()
}

/// The entries of a folder; none when it is not there.
fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    match fs::read_dir(folder) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(e) => Err(io(folder, "read")(e)),
        Ok(entries) => {
            let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
            paths.sort();
            Ok(paths)
        }
    }
}

fn file_name(path: &Path) -> &str {
    path.file_name().and_then(|name| name.to_str()).unwrap_or_default()
}

impl Store {
    /// The folder, made where it is missing. Packed shards are opened: they must be of the same settings.
    pub(super) fn open(folder: &Path, config: &TargetsConfig) -> Result<Self> {
        let clips = folder.join(CLIP_FOLDER);
        fs::create_dir_all(&clips).map_err(io(&clips, "create"))?;
        let mut store =
            Self { folder: folder.to_owned(), config: config.clone(), shards: BTreeMap::new(), write_s: 0.0 };
        for path in entries(folder)? {
            let place = file_name(&path).strip_prefix("targets-").and_then(|name| name.strip_suffix(".safetensors"));
            if let Some(place) = place.and_then(|place| place.parse().ok()) {
                let shard = store.checked(&path)?;
                store.shards.insert(place, shard.names().to_vec());
            }
        }
        Ok(store)
    }

    /// Fails where the folder holds something of the clips already.
    pub(super) fn expect_empty(&self, clips: &[&str], part: Option<Part>) -> Result<()> {
        let mut ours = vec![self.folder.join(MANIFEST_FILE)];
        ours.extend(part.map(|part| self.folder.join(part_file(part))));
        ours.extend(self.shards.keys().map(|&place| self.shard_path(place)));
        ours.extend(clips.iter().map(|clip| self.clip_path(clip)));
        match ours.into_iter().find(|path| path.exists()) {
            None => Ok(()),
            Some(path) => {
                Err(TargetError::unfit("out", "an empty folder, or `resume` to go on", path.display().to_string()))
            }
        }
    }

    /// Takes away what an interrupted write left.
    pub(super) fn sweep(&self) -> Result<()> {
        remove_unfinished(&self.folder)?;
        Ok(remove_unfinished(&self.folder.join(CLIP_FOLDER))?)
    }

    pub(super) fn clip_path(&self, clip: &str) -> PathBuf {
        self.folder.join(CLIP_FOLDER).join(format!("{clip}.safetensors"))
    }

    pub(super) fn shard_path(&self, place: usize) -> PathBuf {
        self.folder.join(lgs_formats::targets::shard_file(place))
    }

    /// A shard of the same settings.
    fn checked(&self, path: &Path) -> Result<Shard> {
        let shard = Shard::read(path)?;
        if *shard.config() == self.config {
            return Ok(shard);
        }
        let text = |config: &TargetsConfig| serde_json::to_string(config).unwrap_or_default();
        Err(FormatError::invalid(path, "config", text(&self.config), text(shard.config())).into())
    }

    /// The shard of one clip, when it is there and whole.
    pub(super) fn clip(&self, clip: &str) -> Result<Option<EncodedClip>> {
        let path = self.clip_path(clip);
        if !path.exists() {
            return Ok(None);
        }
        let shard = self.checked(&path)?;
        if shard.names() != [clip] {
            return Err(FormatError::invalid(&path, "clips", clip, shard.names().join(", ")).into());
        }
        shard.clip(clip)?;
        Ok(shard.encoded(0))
    }

    /// Writes the shard of one clip.
    pub(super) fn put(&self, clip: &str, encoded: &EncodedClip) -> Result<WrittenShard> {
        let path = self.clip_path(clip);
        Ok(write_shard(&path, &self.config, &[(clip, encoded.dims)], |_| Ok(encoded.clone()))?)
    }

    /// Brings the clips of a packed shard back to shards of their own, and takes the packed one away.
    pub(super) fn unpack(&mut self, place: usize) -> Result<()> {
        let path = self.shard_path(place);
        let shard = self.checked(&path)?;
        for (i, name) in shard.names().iter().enumerate() {
            if let Some(encoded) = shard.encoded(i).filter(|_| !self.clip_path(name).exists()) {
                self.put(name, &encoded)?;
            }
        }
        fs::remove_file(&path).map_err(io(&path, "remove"))?;
        self.shards.remove(&place);
        Ok(())
    }

    /// Removes a file when it is there.
    pub(super) fn remove(&self, path: &Path) -> Result<()> {
        match fs::remove_file(path) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(io(path, "remove")(e)),
            _ => Ok(()),
        }
    }

    /// Removes the clips' folder when nothing is left in it.
    pub(super) fn tidy(&self) -> Result<()> {
        let clips = self.folder.join(CLIP_FOLDER);
        if entries(&clips)?.is_empty() { fs::remove_dir(&clips).map_err(io(&clips, "remove")) } else { Ok(()) }
    }

    /// The manifest of the whole job, when it is there and its shards are as it says.
    pub(super) fn manifest(&self) -> Result<Option<Manifest>> {
        let path = self.folder.join(MANIFEST_FILE);
        if !path.exists() {
            return Ok(None);
        }
        let manifest = Manifest::read(&path)?;
        manifest.verify(&self.folder)?;
        Ok(Some(manifest))
    }
}

impl ItemStore for Store {
    type Made = EncodedClip;
    type Error = TargetError;

    fn has(&self, clip: &str) -> Result<bool> {
        Ok(self.shards.values().flatten().any(|name| name == clip) || self.clip(clip)?.is_some())
    }

    fn keep(&mut self, clip: &str, encoded: EncodedClip) -> Result<()> {
        let start = Instant::now();
        self.put(clip, &encoded)?;
        self.write_s += start.elapsed().as_secs_f64();
        Ok(())
    }
}
