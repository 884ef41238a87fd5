//! Which clips a job has, and what they are called.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use lgs_formats::clip_dir::CLIP_FILE;
use lgs_formats::error::FormatError;

use crate::error::{Result, TargetError};

/// Longest name before what tells equal names apart.
const MAX_NAME: usize = 100;

/// A clip of a job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JobClip {
    /// Its name in shards: that of its folder, `~2`, `~3`, ... behind it where it was taken.
    pub name: String,
    /// Its directory.
    pub path: PathBuf,
}

/// The clips that arguments name, in their order: a clip directory, a folder of clip directories (in the order of their names), or a list
/// file with one path a line, from the list's own folder; empty lines and those that start with `#` do not count.
///
/// # Errors
/// An argument that is none of these, and no clip at all.
pub fn find_clips(arguments: &[PathBuf]) -> Result<Vec<JobClip>> {
    let mut paths = Vec::new();
    for argument in arguments {
        let metadata = std::fs::metadata(argument).map_err(|e| FormatError::io(argument, "read", e))?;
        if metadata.is_dir() {
            paths.extend(of_folder(argument)?);
        } else {
            let text = std::fs::read_to_string(argument).map_err(|e| FormatError::io(argument, "read", e))?;
            let folder = argument.parent().unwrap_or(Path::new(""));
            let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
            paths.extend(lines.map(|line| folder.join(line)));
        }
    }
    if paths.is_empty() {
        return Err(TargetError::unfit("CLIPS", "at least one clip", "none"));
    }
    Ok(named(paths))
}

fn of_folder(folder: &Path) -> Result<Vec<PathBuf>> {
    if folder.join(CLIP_FILE).exists() {
        return Ok(vec![folder.to_owned()]);
    }
    let entries = std::fs::read_dir(folder).map_err(|e| FormatError::io(folder, "read", e))?;
    let mut clips: Vec<PathBuf> =
        entries.flatten().map(|entry| entry.path()).filter(|path| path.join(CLIP_FILE).exists()).collect();
    clips.sort();
    if clips.is_empty() {
        let found = format!("{} with no {CLIP_FILE} in it or in a folder of it", folder.display());
        return Err(TargetError::unfit("CLIPS", "a clip directory, a folder of them or a list file", found));
    }
    Ok(clips)
}

fn named(paths: Vec<PathBuf>) -> Vec<JobClip> {
    let mut taken: BTreeMap<String, usize> = BTreeMap::new();
    let name_of = |path: &Path| -> String {
        let canonical =
            || std::fs::canonicalize(path).ok()?.file_name().map(|name| name.to_string_lossy().into_owned());
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).or_else(canonical);
        let plain = |c: char| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '_' };
        name.unwrap_or_else(|| "clip".to_owned()).chars().map(plain).take(MAX_NAME).collect()
    };
    paths
        .into_iter()
        .map(|path| {
            let base = name_of(&path);
            let count = taken.entry(base.clone()).or_insert(0);
            *count += 1;
            let name = if *count == 1 { base } else { format!("{base}~{count}") };
            JobClip { name, path }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_lists_and_directories_become_named_clips() {
        let dir = tempfile::tempdir().unwrap();
        for clip in ["b/x y", "b/a", "c/a"] {
            std::fs::create_dir_all(dir.path().join(clip)).unwrap();
            std::fs::write(dir.path().join(clip).join(CLIP_FILE), "{}").unwrap();
        }
        std::fs::write(dir.path().join("list"), "# comment\n\nb/a\n  c/a \n").unwrap();
        let names_of = |arguments: &[&str]| {
            let paths: Vec<PathBuf> = arguments.iter().map(|a| dir.path().join(a)).collect();
            find_clips(&paths).map(|clips| clips.into_iter().map(|clip| clip.name).collect::<Vec<_>>())
        };
        assert_eq!(names_of(&["b"]).unwrap(), ["a", "x_y"]);
        assert_eq!(names_of(&["list"]).unwrap(), ["a", "a~2"]);
        assert_eq!(names_of(&["b/x y", "b", "list"]).unwrap(), ["x_y", "a", "x_y~2", "a~2", "a~3"]);
        assert!(names_of(&["c/a/clip.json/.."]).is_err() && names_of(&["nowhere"]).is_err() && names_of(&[]).is_err());
        std::fs::create_dir(dir.path().join("empty")).unwrap();
        assert!(names_of(&["empty"]).unwrap_err().to_string().contains("CLIPS: expected a clip directory"));
    }
}
