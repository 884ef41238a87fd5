//! Named tensors of a safetensors file, read into f64.

use std::fs;
use std::path::{Path, PathBuf};

use safetensors::{Dtype, SafeTensors};

/// The content of a safetensors file.
#[derive(Debug)]
pub struct TensorFile {
    path: PathBuf,
    bytes: Vec<u8>,
}

/// A tensor's shape and values.
#[derive(Clone, Debug, PartialEq)]
pub struct Values {
    /// Sizes of its dimensions.
    pub shape: Vec<usize>,
    /// Row-major values.
    pub data: Vec<f64>,
}

impl TensorFile {
    /// The file at `path`.
    ///
    /// # Errors
    /// It cannot be read or is no safetensors file.
    pub fn open(path: &Path) -> Result<Self, String> {
        let bytes = fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
        SafeTensors::deserialize(&bytes).map_err(|e| format!("{}: {e}", path.display()))?;
        Ok(Self { path: path.to_owned(), bytes })
    }

    /// Names of the tensors, sorted.
    ///
    /// # Errors
    /// Never after [`TensorFile::open`].
    pub fn names(&self) -> Result<Vec<String>, String> {
        let mut names: Vec<String> = self.parsed()?.names().into_iter().map(str::to_owned).collect();
        names.sort();
        Ok(names)
    }

    /// The tensor `name`.
    ///
    /// # Errors
    /// It is missing or of a type that goldens do not use.
    pub fn get(&self, name: &str) -> Result<Values, String> {
        let parsed = self.parsed()?;
        let view = parsed.tensor(name).map_err(|e| format!("{}: {name}: {e}", self.path.display()))?;
        let bytes = view.data();
        let data = match view.dtype() {
            Dtype::F64 => words(bytes).map(f64::from_le_bytes).collect(),
            Dtype::F32 => words(bytes).map(|w| f64::from(f32::from_le_bytes(w))).collect(),
            Dtype::I32 => words(bytes).map(|w| f64::from(i32::from_le_bytes(w))).collect(),
            Dtype::I64 => words(bytes).map(|w| i64::from_le_bytes(w) as f64).collect(),
            Dtype::U8 => bytes.iter().map(|&b| f64::from(b)).collect(),
            other => return Err(format!("{}: {name}: unexpected type {other:?}", self.path.display())),
        };
        Ok(Values { shape: view.shape().to_vec(), data })
    }

    /// A text of the file's metadata.
    ///
    /// # Errors
    /// There is none of that name.
    pub fn metadata(&self, key: &str) -> Result<String, String> {
        let fault = |what: String| format!("{}: __metadata__.{key}: {what}", self.path.display());
        let (_, header) = SafeTensors::read_metadata(&self.bytes).map_err(|e| fault(e.to_string()))?;
        let found = header.metadata().as_ref().and_then(|texts| texts.get(key).cloned());
        found.ok_or_else(|| fault("missing".to_owned()))
    }

    /// The values of a tensor of whole numbers, of which f64 would round the large ones.
    ///
    /// # Errors
    /// It is missing or of another type.
    pub fn integers(&self, name: &str) -> Result<Vec<i64>, String> {
        let fault = |what: String| format!("{}: {name}: {what}", self.path.display());
        let parsed = self.parsed()?;
        let view = parsed.tensor(name).map_err(|e| fault(e.to_string()))?;
        match view.dtype() {
            Dtype::I64 => Ok(words(view.data()).map(i64::from_le_bytes).collect()),
            Dtype::I32 => Ok(words(view.data()).map(|w| i64::from(i32::from_le_bytes(w))).collect()),
            other => Err(fault(format!("unexpected type {other:?}"))),
        }
    }

    /// The rows of a tensor whose last dimension is `N`; a tensor of one dimension has rows of one.
    ///
    /// # Errors
    /// It is missing or has another width.
    pub fn rows<const N: usize>(&self, name: &str) -> Result<Vec<[f64; N]>, String> {
        let values = self.get(name)?;
        let (rows, rest) = values.data.as_chunks::<N>();
        if !rest.is_empty() || (N > 1 && values.shape.last() != Some(&N)) {
            return Err(format!("{}: {name}: shape {:?}, want [.., {N}]", self.path.display(), values.shape));
        }
        Ok(rows.to_vec())
    }

    fn parsed(&self) -> Result<SafeTensors<'_>, String> {
        SafeTensors::deserialize(&self.bytes).map_err(|e| format!("{}: {e}", self.path.display()))
    }
}

fn words<const N: usize>(bytes: &[u8]) -> impl Iterator<Item = [u8; N]> + '_ {
    bytes.as_chunks::<N>().0.iter().copied()
}
