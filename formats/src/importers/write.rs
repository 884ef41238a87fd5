//! A clip directory from a clip that was read from anywhere.

use std::{
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
};

use crate::{
    clip::{CameraRecord, Clip, DepthRecord, LidarRecord, ReturnsRecord, SensorsRecord},
    clip_dir::{ClipDir, write_clip},
    error::{FormatError, Result},
    image,
    importers::additions::Additions,
    read::{MAX_DATA_BYTES, read_file},
    returns::{write_sensors, write_times},
    sweep::{Sweep, write_sweep},
    unfinished::Unfinished,
    write::write_atomic,
};

/// Writes the clip directory `out`: the sweeps of `source` decoded, its images as they are. On an error `out` is what it was
/// before: missing or empty.
///
/// # Errors
/// An `out` that holds something already or cannot be written to; sweeps and images that are damaged.
pub fn write(source: &ClipDir, out: &Path) -> Result<()> {
    write_with(source, out, &Additions::default())
}

/// As [`write()`], with what the user has beside the folder.
///
/// # Errors
/// Those of [`write()`]; masks and depth maps that fit no image, are damaged or of another size.
pub fn write_with(source: &ClipDir, out: &Path, additions: &Additions) -> Result<()> {
    let parent = match out.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let holds_something = fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_some());
    let found = match fs::symlink_metadata(out) {
        Ok(metadata) if metadata.is_symlink() => Some("a link"),
        Ok(metadata) if !metadata.is_dir() => Some("a file"),
        _ => (holds_something || out.file_name().is_none()).then_some("one that holds something"),
    };
    if let Some(found) = found {
        return Err(FormatError::unfit(out, "out", "a new or an empty folder", found));
    }
    fs::create_dir_all(parent).map_err(|e| FormatError::io(parent, "create", e))?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(".lgs-").suffix(".part");
    let _unfinished = Unfinished::new();
    let place = builder.tempdir_in(parent).map_err(|e| FormatError::io(out, "create", e))?;
    fill(source, place.path(), additions)?;
    share(place.path(), parent);
    if out.is_dir() {
        fs::remove_dir(out).map_err(|e| FormatError::io(out, "replace", e))?;
    }
    fs::rename(place.path(), out).map_err(|e| FormatError::io(out, "rename to", e))?;
    // The folder has another name now: there is nothing left to remove.
    let _ = place.keep();
    Ok(())
}

/// Gives the temporary folder, which is its owner's alone, the permissions that its parent has.
fn share(folder: &Path, parent: &Path) {
    if let Ok(metadata) = fs::metadata(parent) {
        // A folder that stays its owner's alone is still a good clip.
        let _ = fs::set_permissions(folder, metadata.permissions());
    }
}

fn fill(source: &ClipDir, place: &Path, additions: &Additions) -> Result<()> {
    let make = |name: &str| {
        let folder = place.join(name);
        fs::create_dir_all(&folder).map_err(|e| FormatError::io(&folder, "create", e))
    };
    make("lidar")?;
    make("images")?;
    let mut clip: Clip = source.clip().clone();
    for (f, frame) in clip.frames.iter_mut().enumerate() {
        frame.lidar.file = PathBuf::from(format!("lidar/{f:04}.bin"));
        frame.lidar.returns = write_returns(place, f, &source.load_sweep(f)?, &frame.lidar)?;
        for record in &mut frame.cameras {
            let bytes = source.image_file(record)?;
            image::check_whole(source.root(), record, &bytes)?;
            *record = copied(source.root(), place, f, record, &bytes)?;
        }
    }
    additions.apply(place, &mut clip)?;
    write_clip(place, &clip)
}

/// What a clip says of the returns of a sweep that has been written to the file of `record`.
fn write_returns(place: &Path, frame: usize, sweep: &Sweep, record: &LidarRecord) -> Result<ReturnsRecord> {
    write_sweep(&place.join(&record.file), sweep)?;
    let named = |ending: &str| PathBuf::from(format!("lidar/{frame:04}.{ending}"));
    let mut returns = ReturnsRecord::default();
    if let Some(times) = &sweep.times {
        let file = named("times");
        write_times(&place.join(&file), times)?;
        returns.times = Some(file);
    }
    if let Some((sensors, indices)) = record.returns.sensors.as_ref().zip(sweep.sensors.as_ref()) {
        let file = named("sensors");
        write_sensors(&place.join(&file), indices)?;
        returns.sensors = Some(SensorsRecord { file, lidar_from_sensor: sensors.lidar_from_sensor.clone() });
    }
    Ok(returns)
}

/// The record of the copy of an image, whose file holds `bytes`, of its mask and its depth map.
fn copied(root: &Path, place: &Path, frame: usize, record: &CameraRecord, bytes: &[u8]) -> Result<CameraRecord> {
    let ending = record.file.extension().and_then(OsStr::to_str).unwrap_or("image");
    let name = &record.camera.name;
    let copy = |from: &Path, to: &str| -> Result<PathBuf> {
        write_atomic(&place.join(to), &read_file(&root.join(from), MAX_DATA_BYTES)?)?;
        Ok(PathBuf::from(to))
    };
    let file = PathBuf::from(format!("images/{frame:04}_{name}.{ending}"));
    write_atomic(&place.join(&file), bytes)?;
    let mask = match &record.mask {
        Some(mask) => Some(copy(mask, &format!("images/{frame:04}_{name}_mask.png"))?),
        None => None,
    };
    let depth = match &record.depth {
        Some(depth) => {
            let ending = depth.file.extension().and_then(OsStr::to_str).unwrap_or("depth");
            let file = copy(&depth.file, &format!("images/{frame:04}_{name}_depth.{ending}"))?;
            Some(DepthRecord { file, kind: depth.kind })
        }
        None => None,
    };
    Ok(CameraRecord { file, mask, depth, camera: record.camera.clone() })
}
