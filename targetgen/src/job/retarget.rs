//! Other targets from the raw deltas of shards that are there: nothing is rendered.

use std::path::Path;

use lgs_formats::targets::{
    ClipTargets, EncodedClip, MANIFEST_FILE, Manifest, Shard, ShardRecord, TargetsConfig, ZScore, write_shard,
};

use super::store::Store;
use crate::error::Result;
use crate::target::{Targets, targets};

/// Shards in `out` with the targets of another scale of the logarithm and another population of the z-score.
///
/// # Errors
/// A manifest or shard that is not as it should be, and a folder that holds something or cannot be written to.
pub fn retarget(folder: &Path, out: &Path, log_scale: f64, zscore: ZScore) -> Result<Manifest> {
    let mut manifest = Manifest::read(&folder.join(MANIFEST_FILE))?;
    manifest.verify(folder)?;
    manifest.config = TargetsConfig { log_scale, zscore, ..manifest.config };
    let config = &manifest.config;
    let store = Store::open(out, config)?;
    store.expect_empty(&[], None)?;
    for record in &mut manifest.shards {
        let shard = Shard::read(&folder.join(&record.file))?;
        let encoded = |name: &String| {
            let clip = retargeted(shard.clip(name)?, config);
            EncodedClip::new(&folder.join(&record.file), &clip)
        };
        let clips: Vec<EncodedClip> = shard.names().iter().map(encoded).collect::<lgs_formats::error::Result<_>>()?;
        let dims: Vec<_> = shard.names().iter().zip(&clips).map(|(name, clip)| (name.as_str(), clip.dims)).collect();
        write_shard(&out.join(&record.file), config, &dims, |i| Ok(clips[i].clone()))?;
        *record = ShardRecord::of(out, record.file.clone(), std::mem::take(&mut record.clips))?;
    }
    manifest.write(&out.join(MANIFEST_FILE))?;
    store.tidy()?;
    Ok(manifest)
}

fn retargeted(mut clip: ClipTargets, config: &TargetsConfig) -> ClipTargets {
    let (deltas, masks) = ([&*clip.prune.delta, &clip.add.delta], [&*clip.prune.mask, &clip.add.mask]);
    let Targets { prune, add, moments } = targets(deltas, masks, config);
    (clip.prune, clip.add) = (prune, add);
    clip.moments = moments.map(|moments| [moments.mean, moments.deviation]);
    clip
}
