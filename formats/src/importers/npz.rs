//! `.npz` archives of numpy: zip files of `.npy` arrays.

use std::{fs::File, io::BufReader, path::Path};

use zip::ZipArchive;

use crate::{
    error::{FormatError, Result},
    numpy::{Array, Npy},
    read::{MAX_DATA_BYTES, file_size, read_unpacked},
};

/// The array `name` of an archive.
///
/// # Errors
/// A file that is no archive, one without that array, an array of another form than numpy writes or of values other
/// than numbers.
pub(super) fn read_npz(file: &Path, name: &str) -> Result<Array> {
    let packed = file_size(file, MAX_DATA_BYTES)?;
    let reader = BufReader::new(File::open(file).map_err(|e| FormatError::io(file, "read", e))?);
    let mut archive = ZipArchive::new(reader).map_err(|e| FormatError::syntax(file, "archive", e.to_string()))?;
    let member = format!("{name}.npy");
    let names: Vec<String> = archive.file_names().flatten().map(|name| name.into_owned()).collect();
    if !names.contains(&member) {
        let found = names.iter().take(10).map(String::as_str).collect::<Vec<_>>().join(", ");
        return Err(FormatError::invalid(file, "archive", format!("an array `{name}`"), found));
    }
    let entry = archive.by_name(&member).map_err(|e| FormatError::syntax(file, name, e.to_string()))?;
    let bytes = read_unpacked(file, name, packed, entry)?;
    Npy::parse(file, name, &bytes).map(|npy| npy.array())
}
