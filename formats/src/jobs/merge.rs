//! Parts of a job: what each left, and whether they make a whole.

use std::{
    fs,
    path::{Path, PathBuf},
};

use super::{Part, SHARES_FILE, part_file};
use crate::error::{FormatError, Result};

/// The manifest that a part of a job leaves.
pub trait PartManifest: Sized {
    /// The manifest of a file.
    ///
    /// # Errors
    /// A file that cannot be read or is not as the format asks.
    fn read(path: &Path) -> Result<Self>;

    /// Which part it is of; `None` for that of a whole job.
    fn part(&self) -> Option<Part>;

    /// What decides the results, as JSON: parts of one job have the same.
    fn key(&self) -> String;

    /// Every item of the job, in its order: those of all parts, done or failed.
    fn items(&self) -> &[String];

    /// How often an item was done or failed here.
    fn times_tried(&self, item: &str) -> usize;
}

/// A part's manifest, and where it lies.
#[derive(Clone, Debug)]
pub struct PartFile<M> {
    /// The part's folder.
    pub folder: PathBuf,
    /// The manifest's file.
    pub file: PathBuf,
    /// The manifest.
    pub manifest: M,
    /// Which part it is.
    pub part: Part,
}

/// The parts that lie in the folders, in their order.
///
/// # Errors
/// A folder or manifest that cannot be read, a manifest under the name of another part, and no manifest at all.
pub fn read_parts<M: PartManifest>(folders: &[PathBuf]) -> Result<Vec<PartFile<M>>> {
    let mut parts = Vec::new();
    for folder in folders {
        let entries = fs::read_dir(folder).map_err(|e| FormatError::io(folder, "read", e))?;
        let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        files.sort();
        for file in files {
            let name = file.file_name().and_then(|name| name.to_str()).unwrap_or_default();
            if !(name.starts_with("part-") && name.ends_with(".json")) {
                continue;
            }
            let manifest = M::read(&file)?;
            match manifest.part().filter(|&part| part_file(part) == name) {
                Some(part) => parts.push(PartFile { folder: folder.clone(), file, manifest, part }),
                None => {
                    let found = manifest.part().map_or("none".to_owned(), part_file);
                    return Err(FormatError::invalid(&file, "part", "that of the file's name", found));
                }
            }
        }
    }
    parts.sort_by_key(|part| part.part.index);
    Ok(parts)
}

/// Whether parts are what an earlier merge left that had written its manifest: some are gone, and the whole is of the same job.
pub fn is_merged<M: PartManifest>(parts: &[PartFile<M>], whole: &M) -> bool {
    let same = |part: &PartFile<M>| part.manifest.key() == whole.key() && part.manifest.items() == whole.items();
    parts.first().is_none_or(|first| parts.len() < first.part.count) && parts.iter().all(same)
}

/// Fails where the parts are not those of one job, each once, or do not have every item once.
///
/// # Errors
/// What differs, with the file; no part at all.
pub fn check_parts<M: PartManifest>(folders: &[PathBuf], parts: &[PartFile<M>]) -> Result<()> {
    let place = folders.first().map_or(Path::new(""), PathBuf::as_path);
    let Some(first) = parts.first() else {
        let found = folders.iter().map(|f| f.display().to_string()).collect::<Vec<_>>().join(", ");
        return Err(FormatError::unfit(place, "DIRS", "folders with part-I-of-N.json", found));
    };
    for part in parts {
        let differs = |field: &str, expected: String, found: String| {
            let expected = format!("{expected}, as in {}", first.file.display());
            Err(FormatError::invalid(&part.file, field, expected, found))
        };
        if part.manifest.key() != first.manifest.key() {
            return differs("config", first.manifest.key(), part.manifest.key());
        }
        if part.part.count != first.part.count {
            return differs("part", format!("one of {}", first.part.count), format!("one of {}", part.part.count));
        }
        if part.manifest.items() != first.manifest.items() {
            let count = |manifest: &M| manifest.items().len();
            let expected = format!("the same {}", count(&first.manifest));
            return differs("items", expected, format!("others, {}", count(&part.manifest)));
        }
    }
    for index in 1..=first.part.count {
        let found = parts.iter().filter(|part| part.part.index == index).count();
        if found != 1 {
            let name = part_file(Part { index, count: first.part.count });
            return Err(FormatError::unfit(place, "DIRS", format!("{name} once"), format!("it {found} times")));
        }
    }
    for item in first.manifest.items() {
        let count: usize = parts.iter().map(|part| part.manifest.times_tried(item)).sum();
        if count != 1 {
            return Err(FormatError::unfit(place, "DIRS", format!("{item} in one part"), format!("it in {count}")));
        }
    }
    Ok(())
}

/// Removes the manifests of the parts that lie in `out`, and how its job was divided.
///
/// # Errors
/// A file that cannot be removed.
pub fn remove_parts<M>(parts: &[PartFile<M>], out: &Path) -> Result<()> {
    let remove = |file: &Path| fs::remove_file(file).map_err(|e| FormatError::io(file, "remove", e));
    parts.iter().filter(|part| same_folder(&part.folder, out)).try_for_each(|part| remove(&part.file))?;
    let divided = out.join(SHARES_FILE);
    if divided.exists() { remove(&divided) } else { Ok(()) }
}

/// Whether two paths are the same folder.
pub(super) fn same_folder(a: &Path, b: &Path) -> bool {
    matches!((fs::canonicalize(a), fs::canonicalize(b)), (Ok(a), Ok(b)) if a == b)
}
