//! Shares of a job to the whole.

use std::path::{Path, PathBuf};

use lgs_formats::error::FormatError;
use lgs_formats::targets::{FailedClip, MANIFEST_FILE, Manifest, Part, Shard};

use super::pack::{Plan, pack};
use super::shares::SHARES_FILE;
use super::store::{Store, part_file};
use crate::error::{Result, TargetError};

/// A share and the folder that it lies in.
struct Share {
    folder: PathBuf,
    file: PathBuf,
    manifest: Manifest,
    part: Part,
}

/// Joins the shares in `folders` into shards and one manifest in `out`. Clips of `out` itself are moved, those of other folders copied. Where
/// an earlier call came to its manifest, only what it left of the shares is taken away.
///
/// # Errors
/// Shares that are missing, there twice or of different jobs; clips that none or two of them have; a file that is not as its manifest
/// says; a folder that cannot be written to. What was merged stays, and the same call goes on from there.
pub fn merge(folders: &[PathBuf], out: &Path, shard_bytes: u64) -> Result<Manifest> {
    let shares = shares(folders)?;
    if let Some(manifest) = merged_before(&shares, out)? {
        remove_own(&shares, out)?;
        return Ok(manifest);
    }
    let Some(Share { manifest: first, .. }) = shares.first() else {
        let found = folders.iter().map(|f| f.display().to_string()).collect::<Vec<_>>().join(", ");
        return Err(TargetError::unfit("DIRS", "folders with part-I-of-N.json", found));
    };
    check(&shares)?;
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
    remove_own(&shares, out)?;
    Ok(manifest)
}

/// The manifest in `out` when shares are missing that an earlier call took away after it had written it.
fn merged_before(shares: &[Share], out: &Path) -> Result<Option<Manifest>> {
    let path = out.join(MANIFEST_FILE);
    if shares.first().is_some_and(|first| shares.len() >= first.part.count) || !path.exists() {
        return Ok(None);
    }
    let manifest = Manifest::read(&path)?;
    let same = |share: &Share| share.manifest.config == manifest.config && share.manifest.clips == manifest.clips;
    if !shares.iter().all(same) {
        return Ok(None);
    }
    manifest.verify(out)?;
    Ok(Some(manifest))
}

/// Takes away the shares that lie in `out`.
fn remove_own(shares: &[Share], out: &Path) -> Result<()> {
    for share in shares.iter().filter(|share| same_folder(&share.folder, out)) {
        std::fs::remove_file(&share.file).map_err(|e| FormatError::io(&share.file, "remove", e))?;
    }
    let divided = out.join(SHARES_FILE);
    if divided.exists() {
        std::fs::remove_file(&divided).map_err(|e| FormatError::io(&divided, "remove", e))?;
    }
    Ok(())
}

fn same_folder(a: &Path, b: &Path) -> bool {
    matches!((std::fs::canonicalize(a), std::fs::canonicalize(b)), (Ok(a), Ok(b)) if a == b)
}

/// Every share in the folders.
fn shares(folders: &[PathBuf]) -> Result<Vec<Share>> {
    let mut shares = Vec::new();
    for folder in folders {
        let entries = std::fs::read_dir(folder).map_err(|e| FormatError::io(folder, "read", e))?;
        let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        files.sort();
        for file in files {
            let name = file.file_name().and_then(|name| name.to_str()).unwrap_or_default();
            if !(name.starts_with("part-") && name.ends_with(".json")) {
                continue;
            }
            let manifest = Manifest::read(&file)?;
            match manifest.part {
                Some(part) if part_file(part) == name => {
                    shares.push(Share { folder: folder.clone(), file, manifest, part })
                }
                _ => {
                    let found = manifest.part.map_or("none".to_owned(), part_file);
                    return Err(FormatError::invalid(&file, "part", "that of the file's name", found).into());
                }
            }
        }
    }
    shares.sort_by_key(|share| share.part.index);
    Ok(shares)
}

/// Nothing: the shares are those of one job, each once, and have every clip once.
fn check(shares: &[Share]) -> Result<()> {
    let first = &shares[0];
    for share in shares {
        let differs = |field: &str, expected: String, found: String| {
            Err(FormatError::invalid(&share.file, field, format!("{expected}, as in {}", first.file.display()), found)
                .into())
        };
        let text = |manifest: &Manifest| serde_json::to_string(&manifest.config).unwrap_or_default();
        if share.manifest.config != first.manifest.config {
            return differs("config", text(&first.manifest), text(&share.manifest));
        }
        if share.part.count != first.part.count {
            return differs("part", format!("one of {}", first.part.count), format!("one of {}", share.part.count));
        }
        if share.manifest.clips != first.manifest.clips {
            let count = |manifest: &Manifest| format!("{} clips", manifest.clips.len());
            return differs(
                "clips",
                format!("the same {}", count(&first.manifest)),
                format!("others, {}", count(&share.manifest)),
            );
        }
    }
    for index in 1..=first.part.count {
        let found = shares.iter().filter(|share| share.part.index == index).count();
        if found != 1 {
            let name = part_file(Part { index, count: first.part.count });
            return Err(TargetError::unfit("DIRS", format!("{name} once"), format!("it {found} times")));
        }
    }
    for clip in &first.manifest.clips {
        let done = shares.iter().flat_map(|s| &s.manifest.shards).flat_map(|s| &s.clips).filter(|r| r.clip == *clip);
        let failed = shares.iter().flat_map(|s| &s.manifest.failed).filter(|f| f.clip == *clip);
        let count = done.count() + failed.count();
        if count != 1 {
            return Err(TargetError::unfit("DIRS", format!("clip {clip} in one part"), format!("it in {count}")));
        }
    }
    Ok(())
}
