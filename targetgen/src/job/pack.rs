//! Clips of their own to shards up to a size, as the order of the clips alone decides.

use lgs_formats::error::FormatError;
use lgs_formats::targets::{
    ClipCounts, ClipDims, EncodedClip, FailedClip, MANIFEST_FILE, Manifest, ShardRecord, TARGETS_FORMAT, TargetsConfig,
    shard_file, write_shard,
};

use super::store::Store;
use crate::error::{Result, TargetError};

/// What is known of a clip without its data.
#[derive(Clone, Debug)]
struct Item {
    name: String,
    dims: ClipDims,
    num_valid: [usize; 2],
}

impl Item {
    fn record(&self) -> ClipCounts {
        ClipCounts {
            clip: self.name.clone(),
            primitives: self.dims.primitives,
            sampled: self.dims.sampled,
            valid_prune: self.num_valid[0],
            valid_add: self.num_valid[1],
        }
    }
}

/// What is to be packed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plan<'a> {
    pub(super) config: &'a TargetsConfig,
    /// Every clip of the job.
    pub(super) clips: &'a [String],
    pub(super) failed: &'a [FailedClip],
    /// Most bytes of a shard's data.
    pub(super) shard_bytes: u64,
}

/// The manifest of the packed shards; afterwards the folder holds these and nothing else of the job.
pub(super) fn pack(store: &mut Store, plan: &Plan<'_>) -> Result<Manifest> {
    let failed = |name: &String| plan.failed.iter().any(|failed| failed.clip == *name);
    let done: Vec<&String> = plan.clips.iter().filter(|name| !failed(name)).collect();
    let known = known_items(store, &done)?;
    let groups = group(&known, plan.shard_bytes);
    let names = |group: &[Item]| group.iter().map(|item| item.name.clone()).collect::<Vec<String>>();
    let stale = |place: &usize, held: &Vec<String>| groups.get(*place).map(|group| names(group)) != Some(held.clone());
    let stale: Vec<usize> = store.shards.iter().filter(|(p, held)| stale(p, held)).map(|(&p, _)| p).collect();
    if !stale.is_empty() || store.shards.len() < groups.len() {
        store.remove(&store.folder.join(MANIFEST_FILE))?;
    }
    for place in stale {
        store.unpack(place)?;
    }
    let mut shards = Vec::with_capacity(groups.len());
    for (place, group) in groups.iter().enumerate() {
        let path = store.shard_path(place);
        if !store.shards.contains_key(&place) {
            let dims: Vec<(&str, ClipDims)> = group.iter().map(|item| (item.name.as_str(), item.dims)).collect();
            write_shard(&path, plan.config, &dims, |i| source(store, &group[i].name))?;
            store.shards.insert(place, names(group));
        }
        group.iter().try_for_each(|item| store.remove(&store.clip_path(&item.name)))?;
        shards.push(ShardRecord::of(&store.folder, shard_file(place), group.iter().map(Item::record).collect())?);
    }
    let manifest = Manifest {
        format: TARGETS_FORMAT.to_owned(),
        part: None,
        config: plan.config.clone(),
        clips: plan.clips.to_vec(),
        shards,
        failed: plan.failed.to_vec(),
    };
    manifest.write(&store.folder.join(MANIFEST_FILE))?;
    store.tidy()?;
    Ok(manifest)
}

/// The clip's bytes, for the writer, which speaks the errors of formats.
fn source(store: &Store, name: &str) -> lgs_formats::error::Result<EncodedClip> {
    let path = store.clip_path(name);
    match store.clip(name) {
        Ok(Some(encoded)) => Ok(encoded),
        Ok(None) => Err(FormatError::invalid(&path, "clip", "the shard of the clip", "no file")),
        Err(TargetError::Format(error)) => Err(error),
        Err(error) => Err(FormatError::invalid(&path, "clip", "the shard of the clip", error.to_string())),
    }
}

/// Lengths of every clip that is done, from whichever file holds it.
fn known_items(store: &Store, done: &[&String]) -> Result<Vec<Item>> {
    let mut packed: Vec<(String, EncodedDims)> = Vec::new();
    for &place in store.shards.keys() {
        packed.extend(EncodedDims::of_shard(store, place)?);
    }
    let item = |name: &&String| -> Result<Item> {
        let dims = match packed.iter().find(|(packed, _)| packed == *name) {
            Some((_, dims)) => *dims,
            None => source(store, name).map(|encoded| EncodedDims::of(&encoded))?,
        };
        Ok(Item { name: (*name).clone(), dims: dims.dims, num_valid: dims.num_valid })
    };
    done.iter().map(item).collect()
}

#[derive(Clone, Copy, Debug)]
struct EncodedDims {
    dims: ClipDims,
    num_valid: [usize; 2],
}

impl EncodedDims {
    fn of(encoded: &EncodedClip) -> Self {
        Self { dims: encoded.dims, num_valid: encoded.num_valid }
    }

    fn of_shard(store: &Store, place: usize) -> Result<Vec<(String, Self)>> {
        let shard = lgs_formats::targets::Shard::read(&store.shard_path(place))?;
        let dims = |(i, name): (usize, &String)| Some((name.clone(), Self::of(&shard.encoded(i)?)));
        Ok(shard.names().iter().enumerate().filter_map(dims).collect())
    }
}

/// Runs of clips whose data stay within the cap; a larger clip stands alone.
fn group(items: &[Item], cap: u64) -> Vec<Vec<Item>> {
    let mut groups: Vec<Vec<Item>> = Vec::new();
    let mut bytes = 0;
    for item in items {
        let own = item.dims.bytes() as u64;
        match groups.last_mut().filter(|_| bytes + own <= cap) {
            Some(group) => {
                group.push(item.clone());
                bytes += own;
            }
            None => {
                groups.push(vec![item.clone()]);
                bytes = own;
            }
        }
    }
    groups
}
