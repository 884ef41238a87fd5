//! The weights file of LPIPS, read with all its faults in one message.

use std::{fs::File, io::Read, path::Path};

use lgs_formats::error::FormatError;
use safetensors::{Dtype, SafeTensors};

use crate::error::{EngineError, Result};

/// No file of this network is larger, bytes; the known one has 2.9 MB.
const MAX_BYTES: u64 = 64 << 20;

/// The bytes of a weights file.
///
/// # Errors
/// A file that cannot be read, or that is larger than any file of this network.
pub(super) fn read(path: &Path) -> Result<Vec<u8>> {
    let failed = |error| FormatError::io(path, "read", error);
    let mut bytes = Vec::new();
    File::open(path).map_err(failed)?.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > MAX_BYTES {
        let expected = format!("at most {MAX_BYTES} bytes");
        return Err(fault(path, "size", expected, "more"));
    }
    Ok(bytes)
}

fn fault(path: &Path, field: &str, expected: impl Into<String>, found: impl Into<String>) -> EngineError {
    let (file, field) = (path.display().to_string(), field.to_owned());
    EngineError::Weights { file, field, expected: expected.into(), found: found.into() }
}

/// What is wrong with one tensor.
#[derive(Debug)]
struct TensorFault {
    name: String,
    expected: String,
    found: String,
}

/// Hands out tensors by name and collects what is wrong with them.
#[derive(Debug)]
pub(super) struct WeightReader<'a> {
    path: &'a Path,
    tensors: SafeTensors<'a>,
    faults: Vec<TensorFault>,
}

impl<'a> WeightReader<'a> {
    /// A reader of a file's bytes.
    ///
    /// # Errors
    /// Bytes that are no safetensors file.
    pub(super) fn new(path: &'a Path, bytes: &'a [u8]) -> Result<Self> {
        let tensors = SafeTensors::deserialize(bytes)
            .map_err(|error| fault(path, "header", "a safetensors file", error.to_string()))?;
        Ok(Self { path, tensors, faults: Vec::new() })
    }

    /// The values of a tensor; zeros when it is at fault, which [`Self::finish`] then tells.
    pub(super) fn values(&mut self, name: &str, shape: &[usize]) -> Vec<f32> {
        self.checked_values(name, shape).unwrap_or_else(|found| {
            self.faults.push(TensorFault { name: name.to_owned(), expected: format!("F32 {shape:?}"), found });
            vec![0.0; shape.iter().product()]
        })
    }

    /// The values of a tensor, or what was found instead.
    fn checked_values(&self, name: &str, shape: &[usize]) -> std::result::Result<Vec<f32>, String> {
        let Ok(tensor) = self.tensors.tensor(name) else {
            return Err("missing".to_owned());
        };
        if tensor.dtype() != Dtype::F32 || tensor.shape() != shape {
            return Err(format!("{:?} {:?}", tensor.dtype(), tensor.shape()));
        }
        let (words, _) = tensor.data().as_chunks::<4>();
        let values: Vec<f32> = words.iter().map(|&word| f32::from_le_bytes(word)).collect();
        match values.iter().position(|value| !value.is_finite()) {
            Some(index) => Err(format!("{} at index {index}", values[index])),
            None => Ok(values),
        }
    }

    /// Fails where tensors were at fault.
    ///
    /// # Errors
    /// All tensors at fault, by name, in one error.
    pub(super) fn finish(self) -> Result<()> {
        if self.faults.is_empty() {
            return Ok(());
        }
        let join = |part: fn(&TensorFault) -> &str| {
            let told = self.faults.iter().map(|f| format!("{} {}", f.name, part(f)));
            told.collect::<Vec<_>>().join(", ")
        };
        Err(fault(self.path, "tensors", join(|f| &f.expected), join(|f| &f.found)))
    }
}

#[cfg(test)]
mod tests {
    use safetensors::tensor::TensorView;

    use super::*;

    fn file(tensors: &[(&str, Dtype, Vec<usize>, Vec<u8>)]) -> Vec<u8> {
        let views = tensors
            .iter()
            .map(|(name, dtype, shape, data)| (*name, TensorView::new(*dtype, shape.clone(), data).unwrap()));
        safetensors::serialize(views, None).unwrap()
    }

    fn bytes(values: &[f32]) -> Vec<u8> {
        values.iter().flat_map(|v| v.to_le_bytes()).collect()
    }

    #[test]
    fn values_come_in_order() {
        let bytes = file(&[("a", Dtype::F32, vec![2, 1], bytes(&[1.5, -2.0]))]);
        let mut reader = WeightReader::new(Path::new("w"), &bytes).unwrap();
        assert_eq!(reader.values("a", &[2, 1]), [1.5, -2.0]);
        reader.finish().unwrap();
    }

    #[test]
    fn all_faults_are_told_at_once() {
        let bytes = file(&[
            ("half", Dtype::F16, vec![2], vec![0; 4]),
            ("long", Dtype::F32, vec![3], bytes(&[0.0; 3])),
            ("nan", Dtype::F32, vec![2], bytes(&[0.0, f32::NAN])),
        ]);
        let mut reader = WeightReader::new(Path::new("dir/w"), &bytes).unwrap();
        for name in ["half", "long", "nan", "none"] {
            assert_eq!(reader.values(name, &[2]), [0.0; 2]);
        }
        let message = reader.finish().unwrap_err().to_string();
        let want = "dir/w: tensors: expected half F32 [2], long F32 [2], nan F32 [2], none F32 [2], \
                    found half F16 [2], long F32 [3], nan NaN at index 1, none missing";
        assert_eq!(message, want);
    }

    #[test]
    fn other_files_are_refused() {
        for bytes in [vec![], vec![0; 7], vec![255; 64], b"{}".to_vec(), bytes(&[1.0; 100])] {
            let message = WeightReader::new(Path::new("w"), &bytes).unwrap_err().to_string();
            assert!(message.starts_with("w: header: expected a safetensors file, found "), "{message}");
            assert!(!message.contains('\n'), "{message}");
        }
        let mut cut = file(&[("a", Dtype::F32, vec![2], bytes(&[1.0, 2.0]))]);
        cut.pop();
        WeightReader::new(Path::new("w"), &cut).unwrap_err();
    }

    #[test]
    fn a_file_that_is_not_there_is_named() {
        let message = read(Path::new("no/such/file")).unwrap_err().to_string();
        assert!(message.starts_with("no/such/file: read: "), "{message}");
    }
}
