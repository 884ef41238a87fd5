//! Goldens: values that other implementations computed, with their inputs.

pub mod ptv3;
pub mod render;
pub mod tensors;

use std::fs;
use std::path::PathBuf;

use crate::places;

/// A golden file and the prefix of its cases' names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GoldenFile {
    /// `golden::<kind>::<stem>`, with `given::` before the stem for a file of `$LGS_GOLDEN_DIR`.
    pub name: String,
    /// The file.
    pub path: PathBuf,
}

/// The golden files of a kind with an extension, the shipped ones first, each group by name. Files that start with
/// `bench_` hold inputs to time and no values. `$LGS_GOLDEN_DIR` need not have every kind.
///
/// # Errors
/// A directory that ought to be there cannot be read.
pub fn files(kind: &str, extension: &str) -> Result<Vec<GoldenFile>, String> {
    let shipped = (format!("golden::{kind}::"), places::shipped_goldens(kind));
    let given = given(kind)?.map(|dir| (format!("golden::{kind}::given::"), dir));
    let mut all = Vec::new();
    for (prefix, directory) in [Some(shipped), given].into_iter().flatten() {
        let entries = fs::read_dir(&directory).map_err(|e| format!("{}: {e}", directory.display()))?;
        let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        paths.sort();
        for path in paths.into_iter().filter(|p| p.extension().is_some_and(|e| e == extension)) {
            let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
            if !stem.starts_with("bench_") {
                all.push(GoldenFile { name: format!("{prefix}{stem}"), path });
            }
        }
    }
    Ok(all)
}

/// The directory of a kind in `$LGS_GOLDEN_DIR`; `None` where that has none of the kind.
fn given(kind: &str) -> Result<Option<PathBuf>, String> {
    let Some(directory) = places::given_goldens(kind) else { return Ok(None) };
    match directory.parent() {
        Some(root) if !root.is_dir() => Err(format!("LGS_GOLDEN_DIR: expected a directory, found {}", root.display())),
        _ => Ok(directory.is_dir().then_some(directory)),
    }
}
