//! What foreign layouts write alike: JSON files, quaternions, moments, folders of numbered files.

use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};
use serde::de::DeserializeOwned;

use super::moment;
use crate::{
    clip_json::{syntax_error, without_mark},
    error::{FormatError, Result},
    pose::Pose,
    read::read_file,
};

/// Largest text file that is read whole, bytes.
pub(super) const MAX_TEXT_BYTES: u64 = 1 << 30;
/// Largest deviation of a quaternion's length from 1.
const UNIT_TOLERANCE: f64 = 1e-2;
/// Largest number of files of a folder that are looked at.
const MAX_FILES: usize = 1_000_000;
/// Endings of images.
pub(super) const IMAGE_ENDINGS: [&str; 3] = [".png", ".jpg", ".jpeg"];

/// The value of a JSON file.
///
/// # Errors
/// A file that is missing or too large; keys that are missing and values of other types, by their path.
pub(super) fn read_json<T: DeserializeOwned>(file: &Path) -> Result<T> {
    let bytes = read_file(file, MAX_TEXT_BYTES)?;
    let text = without_mark(&bytes);
    let mut deserializer = serde_json::Deserializer::from_slice(text);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|e| syntax_error(file, text, &e))?;
    deserializer.end().map_err(|e| FormatError::syntax(file, "end of file", e.to_string()))?;
    Ok(value)
}

/// The text of a UTF-8 file.
///
/// # Errors
/// A file that is missing, too large or no UTF-8.
pub(super) fn read_text(file: &Path) -> Result<String> {
    let bytes = read_file(file, MAX_TEXT_BYTES)?;
    let text = std::str::from_utf8(without_mark(&bytes));
    text.map(str::to_owned).map_err(|e| FormatError::invalid(file, "encoding", "UTF-8 text", e.to_string()))
}

/// Where a value stands: what an error about it names.
#[derive(Clone, Copy, Debug)]
pub(super) struct At<'a> {
    pub(super) file: &'a Path,
    pub(super) field: &'a str,
}

impl At<'_> {
    /// An error about the value.
    pub(super) fn error(&self, expected: impl Into<String>, found: impl Into<String>) -> FormatError {
        FormatError::invalid(self.file, self.field, expected, found)
    }

    /// The pose of a quaternion (w, x, y, z) of about unit length and a translation, metres.
    ///
    /// # Errors
    /// Values that are no pose.
    pub(super) fn pose(&self, [w, x, y, z]: [f64; 4], translation: [f64; 3]) -> Result<Pose> {
        let quat = DQuat::from_xyzw(x, y, z, w);
        let length = quat.length();
        if (length - 1.0).abs() <= UNIT_TOLERANCE && translation.iter().all(|v| v.is_finite()) {
            return Ok(Pose::new(DMat3::from_quat(quat.normalize()), DVec3::from(translation)));
        }
        let found = format!("quaternion (w, x, y, z) {w} {x} {y} {z} of length {length}, translation {translation:?}");
        Err(self.error("a unit quaternion and a finite translation", found))
    }

    /// The microseconds since 1970 that a text says: a date, `separator`, a time and `end`.
    ///
    /// # Errors
    /// A text in another format.
    pub(super) fn micros(&self, text: &str, separator: char, end: &str) -> Result<i64> {
        let moment = text.strip_suffix(end).and_then(|moment| moment::micros(moment, separator));
        let expected = || format!("a moment as YYYY-MM-DD{separator}hh:mm:ss.f{end}");
        moment.ok_or_else(|| self.error(expected(), format!("`{text}`")))
    }
}

/// The rotation by `angle` (radians) around z.
pub(super) fn yaw(angle: f64) -> DMat3 {
    DMat3::from_rotation_z(angle)
}

/// Names of the entries of a folder that end in one of `endings`, in small or capital letters, sorted; an empty ending takes all.
/// Hidden files are none.
///
/// # Errors
/// A folder that cannot be read.
pub(super) fn entries(folder: &Path, endings: &[&str]) -> Result<Vec<String>> {
    let listing = std::fs::read_dir(folder).map_err(|e| FormatError::io(folder, "read", e))?;
    let mut names = Vec::new();
    for entry in listing.take(MAX_FILES) {
        let entry = entry.map_err(|e| FormatError::io(folder, "read", e))?;
        let wanted = |name: &&str| !name.starts_with('.') && endings.iter().any(|end| stem(name, end).is_some());
        if let Some(name) = entry.file_name().to_str().filter(wanted) {
            names.push(name.to_owned());
        }
    }
    names.sort_unstable();
    Ok(names)
}

/// The name without its ending, when it has that one, in small or capital letters.
pub(super) fn stem<'a>(name: &'a str, ending: &str) -> Option<&'a str> {
    let (stem, found) = name.split_at_checked(name.len().checked_sub(ending.len())?)?;
    found.eq_ignore_ascii_case(ending).then_some(stem)
}

/// Names of the folders in a folder, sorted.
///
/// # Errors
/// A folder that cannot be read.
pub(super) fn folders(folder: &Path) -> Result<Vec<String>> {
    Ok(entries(folder, &[""])?.into_iter().filter(|name| folder.join(name).is_dir()).collect())
}

/// A file whose name is a number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Numbered {
    pub(super) number: u64,
    pub(super) name: String,
}

/// The files of a folder that are named by a number and one of `endings`, by their number.
///
/// # Errors
/// A folder that cannot be read.
pub(super) fn numbered(folder: &Path, endings: &[&str]) -> Result<Vec<Numbered>> {
    let of_name = |name: String| {
        let number = endings.iter().find_map(|end| stem(&name, end)).and_then(|stem| stem.parse().ok())?;
        Some(Numbered { number, name })
    };
    let mut files: Vec<Numbered> = entries(folder, endings)?.into_iter().filter_map(of_name).collect();
    files.sort_unstable_by_key(|file| file.number);
    Ok(files)
}

/// A path inside a foreign folder, as the folder's own tables write it.
///
/// # Errors
/// An absolute path, or one that leaves the folder.
pub(super) fn inside(at: At<'_>, path: &str) -> Result<PathBuf> {
    use std::path::Component;
    let path = PathBuf::from(path);
    if path.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir)) && path.file_name().is_some() {
        return Ok(path);
    }
    Err(at.error("a path within the folder, without `..`", format!("`{}`", path.display())))
}
