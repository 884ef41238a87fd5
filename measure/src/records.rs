//! What was found, one JSON file for each clip or size: written when it is known, read again when the work goes on.

use std::path::Path;

use lgs_formats::{error::FormatError, write::write_atomic};
use serde::{Serialize, de::DeserializeOwned};

use crate::error::{MeasureError, Result};

/// The name of the files of clip number `index`, without an extension.
pub fn file_stem(index: usize, clip: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || "_-".contains(c) { c } else { '_' };
    let name: String = clip.chars().take(60).map(plain).collect();
    format!("{index:03}_{name}")
}

/// What a JSON file records; `None` where there is none, or one that was not written to its end.
///
/// # Errors
/// When the file cannot be read.
pub fn read_record<T: DeserializeOwned>(file: &Path) -> lgs_formats::error::Result<Option<T>> {
    match std::fs::read_to_string(file) {
        Ok(text) => Ok(serde_json::from_str(&text).ok()),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(FormatError::io(file, "read", error)),
    }
}

/// Writes what is found as JSON.
///
/// # Errors
/// When the file cannot be written.
pub fn write_record(file: &Path, record: &impl Serialize) -> Result<()> {
    Ok(write_atomic(file, json("record", record)?.as_bytes())?)
}

/// A page of JSON for programs, with a line's end.
///
/// # Errors
/// A value that JSON cannot hold.
pub fn json(what: &'static str, page: &impl Serialize) -> Result<String> {
    let text = serde_json::to_string_pretty(page).map_err(|source| MeasureError::Json { what, source })?;
    Ok(text + "\n")
}
