//! Clip directories to run on: the shipped one, copies of it, changed copies.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::places;

/// The clip that the repository ships.
pub fn street() -> PathBuf {
    places::repository().join("clips/street")
}

/// Copies a directory and all that is in it.
///
/// # Errors
/// Reading or writing fails.
pub fn copy(from: &Path, to: &Path) -> std::io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            copy(&entry.path(), &target)?;
        } else {
            fs::copy(entry.path(), target)?;
        }
    }
    Ok(())
}

/// The content of a clip's `clip.json`.
///
/// # Errors
/// It cannot be read.
pub fn description(clip: &Path) -> Result<Value, String> {
    let path = clip.join("clip.json");
    let text = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    serde_json::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))
}

/// Changes a clip's `clip.json`.
///
/// # Errors
/// It cannot be read or written.
pub fn edit(clip: &Path, change: impl FnOnce(&mut Value)) -> Result<(), String> {
    let mut value = description(clip)?;
    change(&mut value);
    let path = clip.join("clip.json");
    fs::write(&path, value.to_string()).map_err(|e| format!("{}: {e}", path.display()))
}

/// Copies the shipped clip with its first `frames` frames and, of each, its first camera alone.
///
/// # Errors
/// Reading or writing fails.
pub fn short(to: &Path, frames: usize) -> Result<(), String> {
    copy(&street(), to).map_err(|e| format!("{}: {e}", to.display()))?;
    edit(to, |description| {
        let all = description["frames"].as_array_mut().into_iter();
        all.for_each(|all| {
            all.truncate(frames);
            all.iter_mut().filter_map(|frame| frame["cameras"].as_array_mut()).for_each(|cameras| cameras.truncate(1));
        });
    })
}

/// The file that a clip's description names at a JSON pointer.
///
/// # Errors
/// The description has no text there.
pub fn named_file(clip: &Path, pointer: &str) -> Result<PathBuf, String> {
    let value = description(clip)?;
    let name = value.pointer(pointer).and_then(Value::as_str).ok_or_else(|| format!("clip.json has no {pointer}"))?;
    Ok(clip.join(name))
}

/// Adds `seconds` to every timestamp and `metres` to every translation of a clip's description.
pub fn shift(description: &mut Value, seconds: f64, metres: [f64; 3]) {
    let frames = description["frames"].as_array_mut().into_iter().flatten();
    for frame in frames {
        add(&mut frame["lidar"]["timestamp"], seconds);
        translate(&mut frame["lidar"]["world_from_lidar"], metres);
        for camera in frame["cameras"].as_array_mut().into_iter().flatten() {
            add(&mut camera["timestamp"], seconds);
            translate(&mut camera["world_from_camera"], metres);
        }
        if let Some(boxes) = frame.get_mut("boxes").and_then(Value::as_array_mut) {
            boxes.iter_mut().for_each(|object| translate(&mut object["world_from_box"], metres));
        }
    }
}

fn translate(pose: &mut Value, metres: [f64; 3]) {
    for (row, by) in metres.into_iter().enumerate() {
        add(&mut pose[row][3], by);
    }
}

fn add(number: &mut Value, by: f64) {
    if let Some(value) = number.as_f64() {
        *number = (value + by).into();
    }
}
