//! Weights from a safetensors file, checked against the model as a whole before any is used.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use candle_core::{DType, Device, Shape, Tensor};
use candle_nn::Init;
use candle_nn::var_builder::SimpleBackend;
use lgs_formats::{digest::sha256, error::FormatError};
use safetensors::{Dtype, SafeTensors};

use super::TensorSpec;
use crate::error::{EngineError, Result};
use crate::ops::DEVICE;

/// At most so many tensors of one kind of fault are named in one error.
const MAX_NAMED: usize = 16;

/// A weights file in memory: tensors in f32, metadata, digest.
#[derive(Clone, Debug)]
pub struct WeightFile {
    file: String,
    tensors: BTreeMap<String, Tensor>,
    metadata: BTreeMap<String, String>,
    sha256: String,
}

impl WeightFile {
    /// Reads a file; f16 and bf16 values become f32.
    ///
    /// # Errors
    /// When the file cannot be read, is no safetensors file, or holds a tensor of another type than f32, f16, bf16.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|source| FormatError::io(path, "read", source))?;
        Self::parse(&path.display().to_string(), &bytes)
    }

    /// As [`WeightFile::read`], from bytes that were read from `file`.
    ///
    /// # Errors
    /// As [`WeightFile::read`].
    pub fn parse(file: &str, bytes: &[u8]) -> Result<Self> {
        let fault = |field: &str, expected: &str, found: String| EngineError::Weights {
            file: file.to_owned(),
            field: field.to_owned(),
            expected: expected.to_owned(),
            found,
        };
        let broken = |error: safetensors::SafeTensorError| fault("header", "a safetensors file", error.to_string());
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(broken)?;
        let content = SafeTensors::deserialize(bytes).map_err(broken)?;
        let mut tensors = BTreeMap::new();
        for (name, view) in content.iter() {
            let dtype = match view.dtype() {
                Dtype::F32 => DType::F32,
                Dtype::F16 => DType::F16,
                Dtype::BF16 => DType::BF16,
                other => return Err(fault(name, "dtype F32, F16 or BF16", format!("{other:?}"))),
            };
            let tensor = Tensor::from_raw_buffer(view.data(), dtype, view.shape(), &DEVICE)?;
            tensors.insert(name.to_owned(), tensor.to_dtype(DType::F32)?);
        }
        let metadata = header.metadata().iter().flatten().map(|(k, v)| (k.clone(), v.clone())).collect();
        let sha256 = sha256(bytes);
        Ok(Self { file: file.to_owned(), tensors, metadata, sha256 })
    }

    /// A value of the file's metadata.
    ///
    /// # Errors
    /// When there is none of that name.
    pub fn metadata(&self, key: &str) -> Result<&str> {
        self.metadata.get(key).map(String::as_str).ok_or_else(|| EngineError::Weights {
            file: self.file.clone(),
            field: format!("__metadata__.{key}"),
            expected: "a string".to_owned(),
            found: "nothing".to_owned(),
        })
    }

    /// SHA-256 of the file, hexadecimal.
    pub fn sha256(&self) -> &str {
        &self.sha256
    }

    /// Checks that the file holds exactly the model's tensors.
    ///
    /// # Errors
    /// One error that names every tensor that is missing, of another shape, not finite, or not used by the model.
    pub fn check(&self, specs: &[TensorSpec]) -> Result<()> {
        let mut faults = Faults::default();
        for spec in specs {
            match self.tensors.get(&spec.name) {
                None => faults.missing.push(spec.name.clone()),
                Some(tensor) if tensor.dims() != spec.shape => {
                    faults.misshaped.push(format!("{} {:?} for {:?}", spec.name, tensor.dims(), spec.shape));
                }
                Some(tensor) => {
                    let values = tensor.flatten_all()?.to_vec1::<f32>()?;
                    if let Some(at) = values.iter().position(|v| !v.is_finite()) {
                        faults.not_finite.push(format!("{} {} at index {at}", spec.name, values[at]));
                    }
                }
            }
        }
        let known: BTreeSet<&str> = specs.iter().map(|s| s.name.as_str()).collect();
        faults.unused = self.tensors.keys().filter(|name| !known.contains(name.as_str())).cloned().collect();
        match faults.text() {
            None => Ok(()),
            Some(found) => Err(EngineError::Weights {
                file: self.file.clone(),
                field: "tensors".to_owned(),
                expected: format!("the {} of the model's config", specs.len()),
                found,
            }),
        }
    }
}

/// Tensors that are not as the model wants them.
#[derive(Debug, Default)]
struct Faults {
    missing: Vec<String>,
    unused: Vec<String>,
    misshaped: Vec<String>,
    not_finite: Vec<String>,
}

impl Faults {
    /// Every kind of fault with its tensors; `None` when there is none.
    fn text(&self) -> Option<String> {
        let kinds = [
            ("missing", &self.missing),
            ("not used by the model", &self.unused),
            ("of another shape", &self.misshaped),
            ("not finite", &self.not_finite),
        ];
        let found = kinds.into_iter().filter(|(_, names)| !names.is_empty()).map(|(kind, names)| {
            let shown = names[..names.len().min(MAX_NAMED)].join(", ");
            let more = names.len().saturating_sub(MAX_NAMED);
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            format!("{} {kind}: {shown}{more}", names.len())
        });
        let found: Vec<String> = found.collect();
        (!found.is_empty()).then(|| found.join("; "))
    }
}

impl SimpleBackend for WeightFile {
    fn get(&self, shape: Shape, name: &str, _init: Init, dtype: DType, device: &Device) -> candle_core::Result<Tensor> {
        match self.tensors.get(name) {
            Some(tensor) if tensor.shape() == &shape => tensor.to_device(device)?.to_dtype(dtype),
            Some(tensor) => candle_core::bail!("tensor {name}: expected shape {shape:?}, found {:?}", tensor.shape()),
            None => candle_core::bail!("tensor {name}: missing"),
        }
    }

    fn get_unchecked(&self, name: &str, _dtype: DType, _device: &Device) -> candle_core::Result<Tensor> {
        self.tensors.get(name).cloned().ok_or_else(|| candle_core::Error::CannotFindTensor { path: name.to_owned() })
    }

    fn contains_tensor(&self, name: &str) -> bool {
        self.tensors.contains_key(name)
    }
}
