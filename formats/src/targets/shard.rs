//! Shards to clips: every length, order and value is checked.

use std::path::{Path, PathBuf};

use safetensors::SafeTensors;

use super::layout::{ClipDims, Placed, SECTIONS, Scalar, is_clip_name, place};
use super::manifest::TARGETS_FORMAT;
use super::{ActionTargets, ClipTargets, EncodedClip, HalfFeatures, NUM_ATTRIBUTES, TargetsConfig};
use crate::error::{FormatError, Result};
use crate::read::{MAX_DATA_BYTES, read_file};

/// A shard whose header was checked.
#[derive(Clone, Debug)]
pub struct Shard {
    path: PathBuf,
    bytes: Vec<u8>,
    /// Place of the data in `bytes`.
    data: usize,
    config: TargetsConfig,
    names: Vec<String>,
    dims: Vec<ClipDims>,
    placed: Vec<Placed>,
}

impl Shard {
    /// The shard of a file.
    ///
    /// # Errors
    /// A file that cannot be read, that is no safetensors file, or whose tensors are not those that the format asks for.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(path, read_file(path, MAX_DATA_BYTES)?)
    }

    /// The shard of bytes; `path` is what errors name.
    ///
    /// # Errors
    /// As [`Shard::read`].
    pub fn parse(path: &Path, bytes: Vec<u8>) -> Result<Self> {
        let not_safe = |e: &dyn std::fmt::Display| FormatError::syntax(path, "header", e.to_string());
        let (header_len, metadata) = SafeTensors::read_metadata(&bytes).map_err(|e| not_safe(&e))?;
        let pairs = metadata.metadata().as_ref();
        let word = |key: &str| pairs.and_then(|pairs| pairs.get(key)).map(String::as_str);
        if word("format") != Some(TARGETS_FORMAT) {
            let found = word("format").unwrap_or("nothing").to_owned();
            return Err(FormatError::invalid(path, "__metadata__.format", TARGETS_FORMAT, found));
        }
        let config = serde_json::from_str(word("config").unwrap_or_default())
            .map_err(|e| FormatError::syntax(path, "__metadata__.config", e.to_string()))?;
        let order = metadata.offset_keys();
        let names: Vec<String> = order.iter().filter_map(|key| key.strip_suffix("/index")).map(str::to_owned).collect();
        let shape = |key: String| metadata.info(&key).map(|info| info.shape.clone()).unwrap_or_default();
        let dims: Vec<ClipDims> = names
            .iter()
            .map(|name| ClipDims {
                sampled: shape(format!("{name}/index")).first().copied().unwrap_or(0),
                primitives: shape(format!("{name}/gaussians")).first().copied().unwrap_or(0),
                frames: metadata.info(&format!("{name}/frame")).is_some(),
                features: shape(format!("{name}/features")).get(1).copied(),
            })
            .collect();
        let bounded = |dims: &ClipDims| {
            [dims.sampled, dims.primitives, dims.features.unwrap_or(0)].iter().all(|&d| d <= bytes.len())
        };
        if let Some(k) = (0..names.len()).find(|&k| !is_clip_name(&names[k]) || !bounded(&dims[k])) {
            return Err(FormatError::invalid(
                path,
                "clip name",
                "1 to 128 letters, digits and . _ ~ -",
                names[k].clone(),
            ));
        }
        let placed = place(&dims);
        if order.len() != placed.len() {
            return Err(FormatError::invalid(
                path,
                "header",
                format!("{} tensors", placed.len()),
                order.len().to_string(),
            ));
        }
        for (found, Placed { clip, tensor, offsets }) in order.iter().zip(&placed) {
            let name = format!("{}/{}", names[*clip], tensor.name);
            let Some(info) = metadata.info(&name) else {
                return Err(FormatError::invalid(
                    path,
                    found.clone(),
                    format!("the tensor {name} at its place"),
                    "another",
                ));
            };
            let found = format!("{:?} {:?} at {:?}", info.dtype, info.shape, info.data_offsets);
            let expected = format!("{} {:?} at {:?}", tensor.scalar.name(), tensor.shape, (offsets[0], offsets[1]));
            if found != expected {
                return Err(FormatError::invalid(path, name, expected, found));
            }
        }
        Ok(Self { path: path.to_owned(), data: header_len + 8, bytes, config, names, dims, placed })
    }

    /// What decided the values.
    pub fn config(&self) -> &TargetsConfig {
        &self.config
    }

    /// Names of the clips, in their order.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The bytes of the clip at a place, when there is one.
    pub fn encoded(&self, clip: usize) -> Option<EncodedClip> {
        let dims = *self.dims.get(clip)?;
        let mut sections: [Vec<u8>; SECTIONS] = Default::default();
        for placed in self.placed.iter().filter(|placed| placed.clip == clip) {
            sections[placed.tensor.scalar.section()].extend_from_slice(self.bytes_of(placed));
        }
        let valid = |mask: &str| self.tensor(clip, mask).iter().filter(|&&byte| byte == 1).count();
        Some(EncodedClip { dims, num_valid: [valid("mask_prune"), valid("mask_add")], sections })
    }

    /// The targets of a clip.
    ///
    /// # Errors
    /// A clip that the shard does not hold, and a value that the format does not allow.
    pub fn clip(&self, name: &str) -> Result<ClipTargets> {
        let Some(clip) = self.names.iter().position(|other| other == name) else {
            return Err(FormatError::invalid(&self.path, name, "a clip of the shard", "none of that name"));
        };
        let floats = |tensor: &str| -> Result<Vec<f32>> {
            let values: Vec<f32> = words(self.tensor(clip, tensor)).map(f32::from_le_bytes).collect();
            match values.iter().position(|v| !v.is_finite()) {
                None => Ok(values),
                Some(i) => Err(self.invalid(clip, tensor, i, "a finite value", values[i])),
            }
        };
        let (prune, add) = (self.action(clip, "prune", &floats)?, self.action(clip, "add", &floats)?);
        let dims = self.dims[clip];
        let index: Vec<u32> = words(self.tensor(clip, "index")).map(u32::from_le_bytes).collect();
        let fits = |i: usize| (index[i] as usize) < dims.primitives && (i == 0 || index[i - 1] < index[i]);
        if let Some(i) = (0..index.len()).find(|&i| !fits(i)) {
            let expected = format!("ascending indices below {}", dims.primitives);
            return Err(self.invalid(clip, "index", i, &expected, index[i]));
        }
        let samples = self.tensor(clip, "samples").to_vec();
        if let Some(i) = samples.iter().position(|&count| count == 0) {
            return Err(self.invalid(clip, "samples", i, "at least 1", 0));
        }
        let moments: Vec<f64> = words(self.tensor(clip, "moments")).map(f64::from_le_bytes).collect();
        if let Some(i) = moments.iter().position(|v| !v.is_finite()) {
            return Err(self.invalid(clip, "moments", i, "a finite value", moments[i]));
        }
        let frames = dims.frames.then(|| words(self.tensor(clip, "frame")).map(u32::from_le_bytes).collect());
        let features = dims.features.map(|width| HalfFeatures {
            width,
            bits: words(self.tensor(clip, "features")).map(u16::from_le_bytes).collect(),
        });
        Ok(ClipTargets {
            index,
            samples,
            prune,
            add,
            moments: [[moments[0], moments[1]], [moments[2], moments[3]]],
            gaussians: floats("gaussians")?.as_chunks::<NUM_ATTRIBUTES>().0.to_vec(),
            times: floats("time")?,
            frames,
            velocities: floats("velocity")?.as_chunks::<3>().0.to_vec(),
            features,
        })
    }

    fn action(&self, clip: usize, name: &str, floats: &dyn Fn(&str) -> Result<Vec<f32>>) -> Result<ActionTargets> {
        let [y_name, delta_name, mask_name] = ["y", "delta", "mask"].map(|kind| format!("{kind}_{name}"));
        let (y, delta, bytes) = (floats(&y_name)?, floats(&delta_name)?, self.tensor(clip, &mask_name));
        for (i, &byte) in bytes.iter().enumerate() {
            if byte > 1 {
                return Err(self.invalid(clip, &mask_name, i, "0 or 1", byte));
            }
            let fits = if byte == 1 { (0.0..=1.0).contains(&y[i]) } else { y[i] == 0.5 };
            if !fits {
                return Err(self.invalid(clip, &y_name, i, "a value from 0 to 1, 0.5 where masked", y[i]));
            }
        }
        Ok(ActionTargets { y, delta, mask: bytes.iter().map(|&byte| byte == 1).collect() })
    }

    fn tensor(&self, clip: usize, name: &str) -> &[u8] {
        let found = self.placed.iter().find(|placed| placed.clip == clip && placed.tensor.name == name);
        found.map_or(&[], |placed| self.bytes_of(placed))
    }

    fn bytes_of(&self, placed: &Placed) -> &[u8] {
        &self.bytes[self.data + placed.offsets[0]..self.data + placed.offsets[1]]
    }

    fn invalid(&self, clip: usize, tensor: &str, i: usize, expected: &str, found: impl ToString) -> FormatError {
        FormatError::invalid(&self.path, format!("{}/{tensor}[{i}]", self.names[clip]), expected, found.to_string())
    }
}

/// Elements of `B` bytes.
fn words<const B: usize>(bytes: &[u8]) -> impl Iterator<Item = [u8; B]> + '_ {
    bytes.as_chunks::<B>().0.iter().copied()
}

const _: () =
    assert!(Scalar::F64.size() == 8 && Scalar::F32.size() == 4 && Scalar::F16.size() == 2 && Scalar::U8.size() == 1);
