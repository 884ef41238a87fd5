//! Shares of a job to the whole.

use std::path::{Path, PathBuf};

use lgs_formats::jobs::{check_parts, is_merged, read_parts, remove_parts};
use lgs_formats::targets::{FailedClip, MANIFEST_FILE, Manifest, Shard};

use super::pack::{Plan, pack};
use super::store::Store;
use crate::error::Result;

/// Joins the shares in `folders` into shards and one manifest in `out`. Clips of `out` itself are moved, those of other folders copied. Where
/// an earlier call came to its manifest, only what it left of the shares is taken away.
///
/// # Errors
/// Shares that are missing, there twice or of different jobs; clips that none or two of them have; a file that is not as its manifest
/// says; a folder that cannot be written to. What was merged stays, and the same call goes on from there.
pub fn merge(folders: &[PathBuf], out: &Path, shard_bytes: u64) -> Result<Manifest> {
    let shares = read_parts::<Manifest>(folders)?;
    let whole = out.join(MANIFEST_FILE);
    if whole.exists() {
        let manifest = Manifest::read(&whole)?;
        if is_merged(&shares, &manifest) {
            manifest.verify(out)?;
            remove_parts(&shares, out)?;
            return Ok(manifest);
        }
    }
    check_parts(folders, &shares)?;
    let first = &shares[0].manifest;
    let mut store = Store::open(out, &first.config)?;
    store.sweep()?;
    for share in &shares {
        for record in &share.manifest.shards {
            let names = || record.clips.iter().map(|clip| clip.clip.as_str());
            let packed = |name: &str| store.shards.values().flatten().any(|held| held == name);
            let path = share.folder.join(&record.file);
            // After an interrupted merge some clips lie in packed shards already.
            if !path.exists() && names().all(packed) {
                continue;
            }
            record.verify(&share.folder)?;
            let shard = Shard::read(&path)?;
            for (i, name) in shard.names().iter().enumerate() {
                let missing = store.clip_path(name) != path && !packed(name);
                if let Some(encoded) = shard.encoded(i).filter(|_| missing) {
                    store.put(name, &encoded)?;
                }
            }
        }
    }
    let failed_of = |name: &String| shares.iter().flat_map(|s| &s.manifest.failed).find(|failed| failed.clip == *name);
    let failed: Vec<FailedClip> = first.clips.iter().filter_map(failed_of).cloned().collect();
    let plan = Plan { config: &first.config, clips: &first.clips, failed: &failed, shard_bytes };
    let manifest = pack(&mut store, &plan)?;
    remove_parts(&shares, out)?;
    Ok(manifest)
}
