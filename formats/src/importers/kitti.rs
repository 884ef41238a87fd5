//! KITTI raw: a date's calibration, and its drives with `image_0x/`, `velodyne_points/` and `oxts/` or `poses.txt`.
//!
//! # Source
//! A. Geiger et al., "Vision meets robotics: the KITTI dataset", 2013, and the readme of its raw development kit. Images of
//! `_sync` drives are rectified; `P_rect` counts pixels from the centre of the first one, so that half a pixel is added. Sweeps are not
//! compensated for the car's motion: where `timestamps_start.txt` and `timestamps_end.txt` say how long the scanner turned, each return is
//! brought to where the scanner was at the sweep's timestamp, when it faced forward.

mod calibration;
mod motion;
mod spin;
mod tracklets;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Arc,
};

use calibration::Calibration;
use motion::Motion;
use spin::{Spin, Spins};

use super::{
    Selection, Source,
    values::{At, IMAGE_ENDINGS, Numbered, folders, numbered, read_text},
};
use crate::{
    camera::{Camera, Intrinsics},
    clip::{CameraRecord, Frame, LidarRecord},
    clip_dir::Decode,
    error::{FormatError, Result},
    sweep::{Sweep, read_sweep},
};

const CALIBRATION: &str = "calib_cam_to_cam.txt";
const SWEEPS: &str = "velodyne_points";

/// Whether a folder is a drive, or a date with drives.
pub(super) fn is_of(folder: &Path) -> bool {
    drives(folder).is_ok_and(|drives| !drives.is_empty())
}

/// The folder of the date of a drive.
fn date_of(drive: &Path) -> PathBuf {
    match (drive.file_name(), drive.parent()) {
        (Some(_), Some(date)) if !date.as_os_str().is_empty() => date.to_owned(),
        _ => drive.join(".."),
    }
}

/// The drive that a folder is, or the drives in it, at most two levels down.
fn drives(folder: &Path) -> Result<Vec<PathBuf>> {
    let is_drive = |place: &Path| place.join(SWEEPS).is_dir() && date_of(place).join(CALIBRATION).is_file();
    if is_drive(folder) {
        return Ok(vec![folder.to_owned()]);
    }
    let below = |place: &Path| -> Result<Vec<PathBuf>> {
        Ok(folders(place)?.into_iter().map(|name| place.join(name)).collect())
    };
    let mut drives = Vec::new();
    for place in below(folder)? {
        if is_drive(&place) {
            drives.push(place);
        } else {
            drives.extend(below(&place)?.into_iter().filter(|place| is_drive(place)));
        }
    }
    Ok(drives)
}

/// The drive that a folder is or that is the only one in it.
fn drive_of(folder: &Path) -> Result<PathBuf> {
    let drives = drives(folder)?;
    if let [one] = drives.as_slice() {
        return Ok(one.clone());
    }
    let names: Vec<String> = drives.iter().take(5).map(|drive| drive.display().to_string()).collect();
    let expected = format!("one folder `*_drive_*_sync` beside a `{CALIBRATION}`");
    Err(FormatError::invalid(folder, "drive", expected, format!("{} {}", drives.len(), names.join(", "))))
}

/// Whether a folder holds some of a drive or of its date.
pub(super) fn resembles(folder: &Path) -> bool {
    [folder.to_owned(), date_of(folder)].iter().any(|place| place.join(CALIBRATION).is_file())
        || [SWEEPS, "oxts"].iter().any(|name| folder.join(name).is_dir())
}

/// The frames of a drive.
pub(super) fn read(folder: &Path, selection: &Selection) -> Result<Source> {
    let drive = drive_of(folder)?;
    let date = date_of(&drive);
    let calibration = Calibration::read(&date)?;
    let times = Times::read(&drive.join(SWEEPS).join("timestamps.txt"))?;
    let files = numbered(&drive.join(SWEEPS).join("data"), &[".bin"])?;
    let motion = Motion::read(&drive, &date, &calibration, &times)?;
    let spins = Spins::read(&drive.join(SWEEPS))?;
    let is_camera = |name: &str| name.strip_prefix("image_").is_some_and(|n| n.len() == 2 && n.parse::<u8>().is_ok());
    let has_images =
        |name: &String| numbered(&drive.join(name).join("data"), &IMAGE_ENDINGS).is_ok_and(|f| !f.is_empty());
    let names: Vec<String> = folders(&drive)?.into_iter().filter(|name| is_camera(name) && has_images(name)).collect();
    let wanted = names.iter().filter(|name| selection.camera(name));
    let sensors = wanted.map(|name| Sensor::read(&drive, name.clone(), &calibration)).collect::<Result<Vec<_>>>()?;
    let mut boxes = tracklets::read(&drive.join("tracklet_labels.xml"))?;
    let mut turns = BTreeMap::new();
    let frame = |sweep: &Numbered| {
        let timestamp = times.of(sweep.number)?;
        let world_from_lidar = motion.world_from_lidar(sweep.number, timestamp)?;
        let file = PathBuf::from(format!("{SWEEPS}/data/{}", sweep.name));
        if let Some(spins) = &spins {
            turns.insert(file.clone(), spins.of(sweep.number, timestamp)?);
        }
        let lidar = LidarRecord::new(file, timestamp, world_from_lidar);
        let cameras = sensors.iter().filter_map(|sensor| sensor.record(sweep.number, &motion).transpose());
        let boxes = boxes.as_mut().map(|boxes| {
            let mut found = boxes.remove(&sweep.number).unwrap_or_default();
            found.iter_mut().for_each(|b| b.world_from_box = world_from_lidar * b.world_from_box);
            found
        });
        Ok(Frame { lidar, cameras: cameras.collect::<Result<_>>()?, boxes })
    };
    let frames = files.iter().map(frame).collect();
    let name = super::folder_name(&drive);
    Ok(Source {
        root: drive,
        source: format!("KITTI raw, {name}"),
        name,
        licence: "CC BY-NC-SA 3.0 (KITTI)".to_owned(),
        frames,
        cameras: names,
        lidars: Vec::new(),
        decoder: Arc::new(Decoder { turns, motion }),
    })
}

/// Moments of a sensor's files by their numbers: line N of `timestamps.txt` is of file N.
#[derive(Debug)]
struct Times {
    file: PathBuf,
    text: String,
}

impl Times {
    fn read(file: &Path) -> Result<Self> {
        Ok(Self { file: file.to_owned(), text: read_text(file)? })
    }

    /// Seconds since 1970 of each number; `None` for lines that say no moment, as those of what was not recorded.
    fn all(&self) -> Vec<Option<f64>> {
        self.text.lines().zip(1..).map(|(line, number)| self.moment(number, line).ok()).collect()
    }

    /// Seconds since 1970.
    fn of(&self, number: u64) -> Result<f64> {
        let line = usize::try_from(number).ok().and_then(|n| self.text.lines().nth(n));
        self.moment(number.saturating_add(1), line.unwrap_or_default())
    }

    #[expect(clippy::cast_precision_loss, reason = "microseconds since 1970 are below 2^53")]
    fn moment(&self, line_number: u64, line: &str) -> Result<f64> {
        let at = At { file: &self.file, field: &format!("line {line_number}") };
        at.micros(line.trim(), ' ', "").map(|micros| micros as f64 / 1e6)
    }
}

/// A camera of a drive.
#[derive(Debug)]
struct Sensor {
    name: String,
    /// The files by their numbers.
    files: Vec<Numbered>,
    times: Times,
    rectified: calibration::Rectified,
    size: [u32; 2],
}

impl Sensor {
    fn read(drive: &Path, name: String, calibration: &Calibration) -> Result<Self> {
        let folder = drive.join(&name).join("data");
        let files = numbered(&folder, &IMAGE_ENDINGS)?;
        let first = files.first().ok_or_else(|| FormatError::invalid(&folder, "images", "at least one", "none"))?;
        let size = crate::image::dimensions(&folder.join(&first.name))?;
        let rectified = calibration.rectified(name.trim_start_matches("image_"))?;
        let times = Times::read(&drive.join(&name).join("timestamps.txt"))?;
        Ok(Self { name, files, times, rectified, size })
    }

    /// The image of number `number`, if there is one.
    fn record(&self, number: u64, motion: &Motion) -> Result<Option<CameraRecord>> {
        let Ok(index) = self.files.binary_search_by_key(&number, |file| file.number) else { return Ok(None) };
        let timestamp = self.times.of(number)?;
        let [width, height] = self.size;
        let Intrinsics { fx, fy, cx, cy } = self.rectified.intrinsics;
        let camera = Camera {
            name: self.name.clone(),
            timestamp,
            width,
            height,
            intrinsics: Intrinsics { fx, fy, cx: cx + 0.5, cy: cy + 0.5 },
            distortion: None,
            readout: None,
            world_from_camera: motion.world_from_camera_0(number, timestamp)? * self.rectified.camera_0_from_this,
        };
        let file = PathBuf::from(format!("{}/data/{}", self.name, self.files[index].name));
        Ok(Some(CameraRecord { file, mask: None, depth: None, camera }))
    }
}

/// Sweeps as this project's own: f32 `x, y, z, reflectance`, each return in the frame of the scanner when it was measured.
#[derive(Debug)]
struct Decoder {
    /// How the scanner turned in each sweep, by its file, where that is known.
    turns: BTreeMap<PathBuf, Spin>,
    motion: Motion,
}

impl Decode for Decoder {
    fn decode(&self, path: &Path, record: &LidarRecord) -> Result<Sweep> {
        let sweep = read_sweep(path)?;
        match self.turns.get(&record.file) {
            Some(spin) => spin.unwound(path, sweep, record, &self.motion),
            None => Ok(sweep),
        }
    }
}
