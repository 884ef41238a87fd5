//! Argoverse 2 sensor logs: feather tables of calibration, poses and annotations, `sensors/lidar/`, `sensors/cameras/`.
//!
//! # Source
//! argoverse/av2-api, `src/av2/datasets/sensor` and `geometry/camera/pinhole_camera.py`: sweeps are in the vehicle's frame at
//! the sweep's own time, which `offset_ns` counts from, images are undistorted already (its issues 219 and 226), so that `k1..k3` describe a lens that
//! no file shows any more. Principal points count from the centre of the first pixel: half a pixel is added.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Arc,
};

use glam::{DMat3, DVec3};

use super::{
    Selection, Source,
    feather::read_feather,
    folder_name,
    nearest::{Shot, image_of_each},
    table::Table,
    trajectory::{Moment, Trajectory},
    values::{At, IMAGE_ENDINGS, Numbered, folders, numbered},
};
use crate::{
    camera::{Camera, Intrinsics},
    clip::{CameraRecord, Frame, LidarRecord, TrackedBox},
    clip_dir::Decode,
    error::{FormatError, Result},
    pose::Pose,
    sweep::Sweep,
};

const MOUNTS: &str = "calibration/egovehicle_SE3_sensor.feather";
const INTRINSICS: &str = "calibration/intrinsics.feather";
const POSES: &str = "city_SE3_egovehicle.feather";
const SWEEPS: &str = "sensors/lidar";
const CAMERAS: &str = "sensors/cameras";
/// The upper of the two `LiDARs`, which stand on each other: the sweep's origin.
const ORIGIN: &str = "up_lidar";
/// Farthest that an image may be from its sweep, seconds: half a revolution of the LiDAR.
const REACH: f64 = 0.05;
const POSE_COLUMNS: [&str; 7] = ["qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m"];

/// Whether a folder is a log.
pub(super) fn is_of(folder: &Path) -> bool {
    folder.join(POSES).is_file() && folder.join(SWEEPS).is_dir()
}

/// Whether a folder holds some of a log.
pub(super) fn resembles(folder: &Path) -> bool {
    folder.join(POSES).is_file() || folder.join(MOUNTS).is_file() || folder.join(SWEEPS).is_dir()
}

/// The frames of a log.
pub(super) fn read(folder: &Path, selection: &Selection) -> Result<Source> {
    let mounts = mounts(&folder.join(MOUNTS))?;
    // Only the place: with the vehicle's axes x is forward.
    let origin = mounts.get(ORIGIN).map_or(DVec3::ZERO, |pose| pose.translation());
    let vehicle_from_lidar = Pose::new(DMat3::IDENTITY, origin);
    let trajectory = trajectory(&folder.join(POSES))?;
    let mut boxes = boxes(&folder.join("annotations.feather"))?;
    let sweeps = numbered(&folder.join(SWEEPS), &[".feather"])?;
    let times: Vec<f64> = sweeps.iter().map(|sweep| seconds(sweep.number)).collect();
    let names = with_images(folder)?;
    let sensors = sensors(folder, &mounts, names.iter().filter(|name| selection.camera(name)))?;
    let images: Vec<Vec<Option<usize>>> = sensors.iter().map(|sensor| sensor.images(&times)).collect();
    let frame = |(index, sweep): (usize, &Numbered)| {
        let timestamp = times[index];
        let world_from_vehicle = trajectory.at(timestamp)?;
        let boxes = boxes.as_mut().map(|boxes| {
            let mut found = boxes.remove(&sweep.number).unwrap_or_default();
            found.iter_mut().for_each(|b| b.world_from_box = world_from_vehicle * b.world_from_box);
            found
        });
        let file = Path::new(SWEEPS).join(&sweep.name);
        let lidar = LidarRecord::new(file, timestamp, world_from_vehicle * vehicle_from_lidar);
        let own = sensors.iter().zip(&images).filter_map(|(sensor, images)| Some((sensor, images[index]?)));
        let cameras = own.map(|(sensor, image)| sensor.record(&sensor.files[image], &trajectory));
        Ok(Frame { lidar, cameras: cameras.collect::<Result<_>>()?, boxes })
    };
    let name = folder_name(folder);
    Ok(Source {
        root: folder.to_owned(),
        source: format!("Argoverse 2 sensor, log {name}"),
        name,
        licence: "CC BY-NC-SA 4.0 (Argoverse)".to_owned(),
        frames: sweeps.iter().enumerate().map(frame).collect(),
        cameras: names,
        lidars: Vec::new(),
        decoder: Arc::new(Decoder { origin }),
    })
}

/// Seconds of a count of nanoseconds.
#[expect(clippy::cast_precision_loss, reason = "2^-22 s at the clock's 3e8 s")]
fn seconds(nanoseconds: u64) -> f64 {
    nanoseconds as f64 / 1e9
}

fn pose_of(file: &Path, row: usize, [w, x, y, z, tx, ty, tz]: [f64; 7]) -> Result<Pose> {
    At { file, field: &format!("row {row}") }.pose([w, x, y, z], [tx, ty, tz])
}

fn mounts(file: &Path) -> Result<BTreeMap<String, Pose>> {
    let table = read_feather(file)?;
    let rows = table.rows(POSE_COLUMNS)?;
    let of_row = |(row, values)| Ok((table.text("sensor_name", row)?.to_owned(), pose_of(file, row, values)?));
    rows.into_iter().enumerate().map(of_row).collect()
}

fn trajectory(file: &Path) -> Result<Trajectory> {
    let table = read_feather(file)?;
    let rows = table.rows(POSE_COLUMNS)?;
    let of_row = |(row, (values, &time))| {
        let time = seconds(moment(file, row, time)?);
        Ok(Moment { time, pose: pose_of(file, row, values)? })
    };
    let moments = rows.into_iter().zip(table.ints("timestamp_ns")?).enumerate().map(of_row).collect::<Result<_>>()?;
    Trajectory::new(file, moments)
}

fn moment(file: &Path, row: usize, nanoseconds: i64) -> Result<u64> {
    let error = |_e| FormatError::invalid(file, format!("timestamp_ns[{row}]"), "a count", nanoseconds.to_string());
    u64::try_from(nanoseconds).map_err(error)
}

/// Boxes by the sweep's count of nanoseconds, in the vehicle's frame; `None` when there is no such file.
fn boxes(file: &Path) -> Result<Option<BTreeMap<u64, Vec<TrackedBox>>>> {
    if !file.exists() {
        return Ok(None);
    }
    let table = read_feather(file)?;
    let (poses, sizes) = (table.rows(POSE_COLUMNS)?, table.rows(["length_m", "width_m", "height_m"])?);
    let mut boxes: BTreeMap<u64, Vec<TrackedBox>> = BTreeMap::new();
    for (row, (&time, (pose, size))) in table.ints("timestamp_ns")?.iter().zip(poses.into_iter().zip(sizes)).enumerate()
    {
        let tracked = TrackedBox {
            track: table.text("track_uuid", row)?.to_owned(),
            category: table.text("category", row)?.to_owned(),
            size,
            world_from_box: pose_of(file, row, pose)?,
        };
        boxes.entry(moment(file, row, time)?).or_default().push(tracked);
    }
    Ok(Some(boxes))
}

/// A camera of a log.
struct Sensor {
    name: String,
    files: Vec<Numbered>,
    intrinsics: Intrinsics,
    size: [u32; 2],
    vehicle_from_camera: Pose,
}

impl Sensor {
    /// `[sweeps]` the image that belongs to each.
    fn images(&self, sweeps: &[f64]) -> Vec<Option<usize>> {
        let shot = |(image, file): (usize, &Numbered)| Shot { image, time: seconds(file.number) };
        image_of_each(sweeps, &self.files.iter().enumerate().map(shot).collect::<Vec<_>>(), REACH)
    }

    fn record(&self, file: &Numbered, trajectory: &Trajectory) -> Result<CameraRecord> {
        let timestamp = seconds(file.number);
        let [width, height] = self.size;
        let camera = Camera {
            name: self.name.clone(),
            timestamp,
            width,
            height,
            intrinsics: self.intrinsics,
            distortion: None,
            readout: None,
            world_from_camera: trajectory.at(timestamp)? * self.vehicle_from_camera,
        };
        Ok(CameraRecord {
            file: PathBuf::from(format!("{CAMERAS}/{}/{}", self.name, file.name)),
            mask: None,
            depth: None,
            camera,
        })
    }
}

/// Names of the cameras that have images.
fn with_images(folder: &Path) -> Result<Vec<String>> {
    let place = folder.join(CAMERAS);
    if !place.is_dir() {
        return Ok(Vec::new());
    }
    let has_images = |name: &String| numbered(&place.join(name), &IMAGE_ENDINGS).is_ok_and(|files| !files.is_empty());
    Ok(folders(&place)?.into_iter().filter(has_images).collect())
}

/// The cameras of these names.
fn sensors<'a>(
    folder: &Path,
    mounts: &BTreeMap<String, Pose>,
    names: impl Iterator<Item = &'a String>,
) -> Result<Vec<Sensor>> {
    let mut names = names.peekable();
    if names.peek().is_none() {
        return Ok(Vec::new());
    }
    let file = folder.join(INTRINSICS);
    let table: Table = read_feather(&file)?;
    let rows = table.rows(["fx_px", "fy_px", "cx_px", "cy_px", "width_px", "height_px"])?;
    let known = (0..table.len()).map(|row| table.text("sensor_name", row)).collect::<Result<Vec<_>>>()?;
    let of_name = |name: &String| {
        let row = known.iter().position(|found| found == name);
        let (Some(row), Some(&vehicle_from_camera)) = (row, mounts.get(name)) else {
            let found = format!("{}: a choice of cameras can leave it out", known.join(", "));
            return Err(FormatError::invalid(&file, "sensor_name", format!("`{name}`"), found));
        };
        let [fx, fy, cx, cy, width, height] = rows[row];
        let side = |value: f64, key: &str| {
            pixels(value).ok_or_else(|| {
                FormatError::invalid(&file, format!("{key}[{row}]"), "a number of pixels", value.to_string())
            })
        };
        Ok(Sensor {
            files: numbered(&folder.join(CAMERAS).join(name), &IMAGE_ENDINGS)?,
            name: name.clone(),
            intrinsics: Intrinsics { fx, fy, cx: cx + 0.5, cy: cy + 0.5 },
            size: [side(width, "width_px")?, side(height, "height_px")?],
            vehicle_from_camera,
        })
    };
    names.map(of_name).collect()
}

/// A whole number of pixels.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole and within the range of u32")]
fn pixels(value: f64) -> Option<u32> {
    (value.fract() == 0.0 && (1.0..=f64::from(u32::MAX)).contains(&value)).then_some(value as u32)
}

/// Sweeps in feather files, in the vehicle's frame.
#[derive(Debug)]
struct Decoder {
    /// The LiDAR in the vehicle's frame, metres.
    origin: DVec3,
}

impl Decode for Decoder {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "metres and intensities of a sensor, kept as f32 by the format"
    )]
    fn decode(&self, path: &Path, _record: &LidarRecord) -> Result<Sweep> {
        let table = read_feather(path)?;
        let rows = table.rows(["x", "y", "z", "intensity"])?;
        let o = self.origin;
        let sweep = Sweep::of_rows(
            path,
            rows.into_iter()
                .map(|[x, y, z, intensity]| [x - o.x, y - o.y, z - o.z, intensity].map(|value| value as f32)),
        )?;
        if !table.has("offset_ns") {
            return Ok(sweep);
        }
        sweep.with_times(path, table.floats("offset_ns")?.iter().map(|nanoseconds| nanoseconds / 1e9))
    }
}
