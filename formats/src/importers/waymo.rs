//! The Waymo Open Dataset: a `TFRecord` file of messages a drive, or (its second form) folders of Parquet files, one a component and drive.
//!
//! Neither is read whole: a frame is looked through once for where its images and range images are, and each is read when it is asked for.
//!
//! # Source
//! waymo-research/waymo-open-dataset, `src/waymo_open_dataset/dataset.proto`, `utils`, `v2`. The pose of a frame belongs to the front camera's image
//! (its issue 464), `LiDARs` turn clockwise as seen from above, ten times a second, from behind over the left (its issue 619; the moments of the
//! images say the same). Principal points count from the edge of the first pixel, as its camera model does.

mod components;
mod crc32c;
mod drive;
mod frame;
mod matrix;
mod record;
mod returns;
mod snapshot;
mod wire;

use std::{
    ops::Range,
    path::{Path, PathBuf},
    sync::Arc,
};

use components::Components;
use drive::{Drive, Store};
use snapshot::{MAX_IMAGE_BYTES, RangeImage, Snapshot, camera_names, laser_names};

use super::{
    Selection, Source,
    values::{entries, stem},
};
use crate::{
    clip::Frame,
    error::{FormatError, Result},
};

const RECORDS: &str = ".tfrecord";
const TABLES: &str = ".parquet";
/// Most names that an error lists.
const MAX_NAMES: usize = 10;

/// Whether a path is a drive, or a folder of drives.
pub(super) fn is_of(path: &Path) -> bool {
    if path.is_dir() { drives(path).is_ok_and(|drives| !drives.is_empty()) } else { record::is_of(path) }
}

/// Whether a path has the name of a drive, or is a folder of some of what a drive has.
pub(super) fn resembles(path: &Path) -> bool {
    if !path.is_dir() {
        return path.file_name().is_some_and(|name| stem(&name.to_string_lossy(), RECORDS).is_some());
    }
    let has_tables = |name: &&str| entries(&path.join(name), &[TABLES]).is_ok_and(|names| !names.is_empty());
    ["camera_image", "lidar_calibration", components::VEHICLE_POSE].iter().any(has_tables)
}

/// A drive in a folder.
struct DriveFile {
    root: PathBuf,
    /// Name of its file without the ending, or of those of all components.
    name: String,
    is_record: bool,
}

/// The drives of a folder, of the first form if it has any.
fn drives(folder: &Path) -> Result<Vec<DriveFile>> {
    let found = |place: &Path, ending: &str| -> Result<Vec<DriveFile>> {
        let is_record = ending == RECORDS;
        let names = entries(place, &[ending])?;
        let drive = |name: &String| {
            Some(DriveFile { root: folder.to_owned(), name: stem(name, ending)?.to_owned(), is_record })
        };
        Ok(names.iter().filter_map(drive).collect())
    };
    let records = found(folder, RECORDS)?;
    let lidar = folder.join(components::LIDAR);
    if records.is_empty() && lidar.is_dir() { found(&lidar, TABLES) } else { Ok(records) }
}

/// Names of the drives of a folder.
pub(super) fn scenes(folder: &Path) -> Result<Vec<String>> {
    Ok(drives(folder)?.into_iter().map(|drive| drive.name).collect())
}

/// The drive of a name, or the only one.
fn choose(path: &Path, name: Option<&str>) -> Result<DriveFile> {
    let mut drives = drives(path)?;
    let known: Vec<String> = drives.iter().take(MAX_NAMES).map(|drive| drive.name.clone()).collect();
    let count = drives.len();
    drives.retain(|drive| name.is_none_or(|name| name == drive.name));
    if drives.len() == 1 {
        return Ok(drives.swap_remove(0));
    }
    if count == 0 {
        let expected = format!("a file `*{RECORDS}`, or `{}/*{TABLES}`", components::LIDAR);
        return Err(FormatError::invalid(path, "drive", expected, "none"));
    }
    let expected =
        name.map_or_else(|| "the name of one, for lgs-clip to import it alone".to_owned(), |name| format!("`{name}`"));
    let more = if known.len() < count { ", ..." } else { "" };
    Err(FormatError::unfit(path, "scene", expected, format!("{count} drives: {}{more}", known.join(", "))))
}

/// The frames of a drive.
pub(super) fn read(path: &Path, selection: &Selection) -> Result<Source> {
    if path.is_dir() {
        let found = choose(path, selection.scene.as_deref())?;
        if !found.is_record {
            let (components, snapshots) = Components::read(&found.root, &found.name)?;
            let file = found.root.join(components.sweeps());
            return Ok(source(found.root, &file, components, found.name, snapshots, selection));
        }
        let file = found.root.join(format!("{}{RECORDS}", found.name));
        return read_record(&file, selection);
    }
    if let Some(scene) = &selection.scene {
        let expected = "none: a file holds one drive";
        return Err(FormatError::unfit(path, "scene", expected, format!("`{scene}`")));
    }
    read_record(path, selection)
}

/// The frames of a drive of the first form. Of frames that are not wanted nothing but the length is read.
fn read_record(path: &Path, selection: &Selection) -> Result<Source> {
    let mut segment = None;
    let snapshots = record::index(path)?.into_iter().enumerate().map(|(index, content)| {
        let content = content?;
        if !selection.frame(index) {
            return Err(FormatError::invalid(path, format!("record {index}"), "one that is wanted", "another"));
        }
        record::check(path, index, &content)?;
        let found = frame::read(path, index, &content)?;
        segment.get_or_insert(found.segment);
        Ok(found.snapshot)
    });
    let snapshots: Vec<Result<Snapshot<Range<u64>>>> = snapshots.collect();
    let name = segment.filter(|name| !name.is_empty()).unwrap_or_else(|| "drive".to_owned());
    let root = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        _ => PathBuf::from("."),
    };
    let file = path.file_name().map(PathBuf::from).unwrap_or_default();
    let records = Records { path: path.to_owned(), file };
    Ok(source(root, path, records, name, snapshots, selection))
}

/// A drive whose frames have been looked through; errors name `file`.
fn source<S: Store + 'static>(
    root: PathBuf,
    file: &Path,
    store: S,
    name: String,
    snapshots: Vec<Result<Snapshot<S::Place>>>,
    selection: &Selection,
) -> Source {
    let mut drive = Drive::new(store);
    let mut cameras = Vec::new();
    let frame = |(index, snapshot): (usize, Result<Snapshot<S::Place>>)| {
        let snapshot = snapshot?;
        cameras.extend(snapshot.images.iter().map(|image| image.sensor.name().to_owned()));
        drive.frame(file, index, &snapshot, selection)
    };
    let frames: Vec<Result<Frame>> = snapshots.into_iter().enumerate().map(frame).collect();
    if frames.iter().all(Result::is_err) {
        // Nothing is known of the cameras: what is wrong with the frames is said, not that they have none.
        cameras = camera_names();
    }
    Source {
        root,
        source: format!("Waymo Open Dataset, {name}"),
        name: format!("waymo_{name}"),
        licence: "Waymo Dataset License Agreement for Non-Commercial Use".to_owned(),
        frames,
        cameras,
        lidars: laser_names(),
        decoder: Arc::new(drive),
    }
}

/// A file of records.
#[derive(Debug)]
struct Records {
    path: PathBuf,
    /// Relative to its folder.
    file: PathBuf,
}

impl Store for Records {
    type Place = Range<u64>;

    fn sweeps(&self) -> &Path {
        &self.file
    }

    fn images(&self) -> &Path {
        &self.file
    }

    fn image(&self, name: &str, place: &Range<u64>) -> Result<Vec<u8>> {
        matrix::content(&self.path, name, place, MAX_IMAGE_BYTES)
    }

    fn range_image(&self, name: &str, place: &Range<u64>) -> Result<Option<RangeImage>> {
        matrix::range_image(&self.path, name, place).map(Some)
    }
}
