//! Clips to shards.

use std::{fs::File, io::Write, path::Path};

use sha2::{Digest, Sha256};

use super::layout::{ClipDims, SECTIONS, Scalar, header, is_clip_name};
use super::manifest::TARGETS_FORMAT;
use super::{ActionTargets, ClipTargets, TargetsConfig};
use crate::digest::hexadecimal;
use crate::error::{FormatError, Result};
use crate::write::write_atomic_with;

/// The bytes of one clip, section by section; the same in every shard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EncodedClip {
    /// Lengths of the tensors.
    pub dims: ClipDims,
    /// Targets of pruning and of adding that the masks admit.
    pub num_valid: [usize; 2],
    pub(super) sections: [Vec<u8>; SECTIONS],
}

/// A shard that was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WrittenShard {
    /// Size, bytes.
    pub bytes: u64,
    /// SHA-256, hexadecimal.
    pub sha256: String,
}

impl EncodedClip {
    /// The bytes of a clip's targets.
    ///
    /// # Errors
    /// Columns of different lengths; `path` is what the error names.
    pub fn new(path: &Path, targets: &ClipTargets) -> Result<Self> {
        check_lengths(path, targets)?;
        let dims = targets.dims();
        let mut sections = dims.section_bytes().map(Vec::with_capacity);
        let (prune, add) = (&targets.prune, &targets.add);
        let mut put = |scalar: Scalar, bytes: &mut dyn Iterator<Item = u8>| sections[scalar.section()].extend(bytes);
        let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        put(Scalar::F64, &mut targets.moments.as_flattened().iter().flat_map(|v| v.to_le_bytes()));
        put(Scalar::U32, &mut targets.index.iter().flat_map(|v| v.to_le_bytes()));
        let columns = [
            prune.y.as_slice(),
            &add.y,
            &prune.delta,
            &add.delta,
            targets.gaussians.as_flattened(),
            &targets.times,
            targets.velocities.as_flattened(),
        ];
        columns.into_iter().for_each(|column| put(Scalar::F32, &mut floats(column).into_iter()));
        if let Some(frames) = &targets.frames {
            put(Scalar::U32, &mut frames.iter().flat_map(|v| v.to_le_bytes()));
        }
        if let Some(features) = &targets.features {
            put(Scalar::F16, &mut features.bits.iter().flat_map(|v| v.to_le_bytes()));
        }
        for mask in [&prune.mask, &add.mask] {
            put(Scalar::U8, &mut mask.iter().map(|&set| u8::from(set)));
        }
        put(Scalar::U8, &mut targets.samples.iter().copied());
        let valid = |action: &ActionTargets| action.mask.iter().filter(|set| **set).count();
        Ok(Self { dims, num_valid: [valid(prune), valid(add)], sections })
    }
}

fn check_lengths(path: &Path, targets: &ClipTargets) -> Result<()> {
    let (m, n) = (targets.index.len(), targets.gaussians.len());
    let actions = [("prune", &targets.prune), ("add", &targets.add)];
    let per_action = |(name, action): (&'static str, &ActionTargets)| {
        [action.y.len(), action.delta.len(), action.mask.len()].map(|len| (name, len, m))
    };
    let mut lengths: Vec<(&str, usize, usize)> = actions.into_iter().flat_map(per_action).collect();
    lengths.push(("samples", targets.samples.len(), m));
    lengths.push(("time", targets.times.len(), n));
    lengths.push(("velocity", targets.velocities.len(), n));
    lengths.extend(targets.frames.as_ref().map(|frames| ("frame", frames.len(), n)));
    lengths.extend(targets.features.as_ref().map(|f| ("features", f.bits.len(), n * f.width)));
    match lengths.into_iter().find(|(_, found, expected)| found != expected) {
        None => Ok(()),
        Some((name, found, expected)) => {
            Err(FormatError::invalid(path, name, format!("{expected} values"), found.to_string()))
        }
    }
}

/// A shard of clips, written to a temporary name, synced and renamed. `clip` gives the clips by their place in `names` and is asked
/// for each of them once a section, so that one is in memory at a time.
///
/// # Errors
/// A name that cannot stand in a shard or stands in it twice, what `clip` says, and a path that cannot be written to.
pub fn write_shard(
    path: &Path,
    config: &TargetsConfig,
    clips: &[(&str, ClipDims)],
    mut clip: impl FnMut(usize) -> Result<EncodedClip>,
) -> Result<WrittenShard> {
    for (i, (name, _)) in clips.iter().enumerate() {
        if !is_clip_name(name) || clips[..i].iter().any(|(other, _)| other == name) {
            let expected = "distinct names of 1 to 128 letters, digits and . _ ~ -";
            return Err(FormatError::invalid(path, format!("clip {i}"), expected, format!("{name:?}")));
        }
    }
    let json = |e: serde_json::Error| FormatError::invalid(path, "header", "values that JSON can hold", e.to_string());
    let config = serde_json::to_string(config).map_err(json)?;
    let (names, dims): (Vec<&str>, Vec<ClipDims>) = clips.iter().copied().unzip();
    let head = header(&names, &dims, TARGETS_FORMAT, &config).map_err(json)?;
    write_atomic_with(path, |file| {
        let mut out = Hashing { path, file, digest: Sha256::new(), bytes: 0 };
        out.put(&head)?;
        for section in (0..SECTIONS).filter(|&s| dims.iter().any(|d| d.section_bytes()[s] > 0)) {
            for (i, dims) in dims.iter().enumerate() {
                let encoded = clip(i)?;
                if encoded.dims != *dims {
                    return Err(FormatError::invalid(
                        path,
                        names[i],
                        format!("{dims:?}"),
                        format!("{:?}", encoded.dims),
                    ));
                }
                out.put(&encoded.sections[section])?;
            }
        }
        Ok(WrittenShard { bytes: out.bytes, sha256: hexadecimal(&out.digest.finalize()) })
    })
}

struct Hashing<'a> {
    path: &'a Path,
    file: &'a mut File,
    digest: Sha256,
    bytes: u64,
}

impl Hashing<'_> {
    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.digest.update(bytes);
        self.bytes += bytes.len() as u64;
        self.file.write_all(bytes).map_err(|e| FormatError::io(self.path, "write", e))
    }
}
