//! Which tensor stands where in a shard.

use serde::Serialize;

use super::NUM_ATTRIBUTES;

/// Longest name of a clip, bytes.
pub const MAX_CLIP_NAME: usize = 128;

/// Whether a name can stand in a shard: 1 to 128 letters, digits, `.`, `_`, `~` and `-`.
pub fn is_clip_name(name: &str) -> bool {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b"._~-".contains(&b);
    (1..=MAX_CLIP_NAME).contains(&name.len()) && name.bytes().all(plain)
}

/// Lengths of one clip's tensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClipDims {
    /// Sampled primitives, M.
    pub sampled: usize,
    /// Primitives of the `LiDAR` branch, N.
    pub primitives: usize,
    /// Whether the frame of each primitive is known.
    pub frames: bool,
    /// Width of the features, when there are any.
    pub features: Option<usize>,
}

/// Element type of a tensor; the sections of a shard, in their order, hold those of one size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    F64,
    U32,
    F32,
    F16,
    U8,
}

/// Sections of a shard: elements of 8, 4, 2 and 1 bytes, so that every tensor is aligned.
pub(super) const SECTIONS: usize = 4;

impl Scalar {
    pub(super) const fn section(self) -> usize {
        match self {
            Self::F64 => 0,
            Self::U32 | Self::F32 => 1,
            Self::F16 => 2,
            Self::U8 => 3,
        }
    }

    pub(super) const fn size(self) -> usize {
        8 >> self.section()
    }

    /// The name that safetensors has for it.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::F64 => "F64",
            Self::U32 => "U32",
            Self::F32 => "F32",
            Self::F16 => "F16",
            Self::U8 => "U8",
        }
    }
}

/// One tensor of a clip.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Tensor {
    pub(super) name: &'static str,
    pub(super) scalar: Scalar,
    pub(super) shape: Vec<usize>,
}

impl Tensor {
    pub(super) fn bytes(&self) -> usize {
        self.scalar.size() * self.shape.iter().product::<usize>()
    }
}

/// A tensor of a shard with its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Placed {
    pub(super) clip: usize,
    pub(super) tensor: Tensor,
    /// First byte and the one beyond the last, from the start of the data.
    pub(super) offsets: [usize; 2],
}

impl ClipDims {
    /// The tensors of a clip, in the order of a shard.
    pub(super) fn tensors(&self) -> Vec<Tensor> {
        let (m, n) = (self.sampled, self.primitives);
        let tensor = |name, scalar, shape: &[usize]| Tensor { name, scalar, shape: shape.to_vec() };
        let mut tensors = vec![
            tensor("moments", Scalar::F64, &[2, 2]),
            tensor("index", Scalar::U32, &[m]),
            tensor("y_prune", Scalar::F32, &[m]),
            tensor("y_add", Scalar::F32, &[m]),
            tensor("delta_prune", Scalar::F32, &[m]),
            tensor("delta_add", Scalar::F32, &[m]),
            tensor("gaussians", Scalar::F32, &[n, NUM_ATTRIBUTES]),
            tensor("time", Scalar::F32, &[n]),
            tensor("velocity", Scalar::F32, &[n, 3]),
        ];
        tensors.extend(self.frames.then(|| tensor("frame", Scalar::U32, &[n])));
        tensors.extend(self.features.map(|width| tensor("features", Scalar::F16, &[n, width])));
        tensors.extend(["mask_prune", "mask_add", "samples"].map(|name| tensor(name, Scalar::U8, &[m])));
        tensors
    }

    /// Bytes of the clip's part of each section.
    pub(super) fn section_bytes(&self) -> [usize; SECTIONS] {
        let mut bytes = [0; SECTIONS];
        self.tensors().iter().for_each(|tensor| bytes[tensor.scalar.section()] += tensor.bytes());
        bytes
    }

    /// Bytes of the clip's data.
    pub fn bytes(&self) -> usize {
        self.section_bytes().iter().sum()
    }
}

/// Every tensor of a shard: section by section, in a section clip by clip.
pub(super) fn place(clips: &[ClipDims]) -> Vec<Placed> {
    let mut placed = Vec::new();
    let mut at = 0;
    for section in 0..SECTIONS {
        for (clip, dims) in clips.iter().enumerate() {
            for tensor in dims.tensors().into_iter().filter(|tensor| tensor.scalar.section() == section) {
                let end = at + tensor.bytes();
                placed.push(Placed { clip, tensor, offsets: [at, end] });
                at = end;
            }
        }
    }
    placed
}

#[derive(Serialize)]
struct TensorHeader<'a> {
    dtype: &'static str,
    shape: &'a [usize],
    data_offsets: [usize; 2],
}

/// The header of a shard: its length as a little-endian u64, then JSON, filled up with spaces to a multiple of 8 bytes.
pub(super) fn header(
    names: &[&str],
    clips: &[ClipDims],
    format: &str,
    config: &str,
) -> Result<Vec<u8>, serde_json::Error> {
    let text = |value: &str| serde_json::to_string(value);
    let mut json = format!("{{\"__metadata__\":{{\"config\":{},\"format\":{}}}", text(config)?, text(format)?);
    for Placed { clip, tensor, offsets } in place(clips) {
        let header = TensorHeader { dtype: tensor.scalar.name(), shape: &tensor.shape, data_offsets: offsets };
        let name = format!("{}/{}", names[clip], tensor.name);
        json += &format!(",{}:{}", text(&name)?, serde_json::to_string(&header)?);
    }
    json.push('}');
    json.extend(std::iter::repeat_n(' ', json.len().next_multiple_of(8) - json.len()));
    let mut bytes = (json.len() as u64).to_le_bytes().to_vec();
    bytes.extend_from_slice(json.as_bytes());
    Ok(bytes)
}
