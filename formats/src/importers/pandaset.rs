//! `PandaSet` sequences: `lidar/` and `annotations/cuboids/` of pickled frames of pandas, `camera/` of JPEG images.
//!
//! Points lie in the world, and two `LiDARs` measured them: the turning Pandar64 (`d = 0`) and the forward-looking `PandarGT` (`d = 1`). An object seen by both has two boxes, of which the Pandar64's is kept. `t` is the moment of each
//! point, for whose motion of the car its place already accounts.
//!
//! # Source
//! scaleapi/pandaset-devkit: `python/pandaset`, whose `geometry.projection` knows no lens. Images are rectified already: what two images of
//! one camera, or of two side by side, show of the same returns is more alike without the distortion of
//! `docs/static_extrinsic_calibration.yaml`, in all six cameras (over two of them, 40 % of the variance of brightness stays unexplained without
//! it, 98 % with it). Shutters roll from the top down, from 30 ms before the moment of an image until 10 ms after it: so Tonderski et al., `NeuRAD`
//! (2024), and so 11 images at 540x960 are reconstructed best, by 0.4 dB; with other readouts of 0 to 50 ms and other moments by less.
//! Calibration follows `OpenCV`, which counts from the centre of the first pixel: half a pixel is added.

mod lidars;

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use glam::DVec3;
use lidars::{PANDAR_GT, PANDAR64};
use serde::Deserialize;

use super::{
    Selection, Source, folder_name,
    pickle::read_frame,
    values::{At, IMAGE_ENDINGS, Numbered, entries, folders, numbered, read_json, yaw},
};
use crate::{
    camera::{Camera, Intrinsics, Readout, ReadoutDirection},
    clip::{CameraRecord, Frame, LidarRecord, SensorsRecord, TrackedBox},
    clip_dir::Decode,
    error::{FormatError, Result},
    pose::Pose,
    sweep::Sweep,
};

const FRAME_ENDINGS: [&str; 2] = [".pkl.gz", ".pkl"];
const CUBOIDS: &str = "annotations/cuboids";
/// Shutter of all cameras.
const SHUTTER: Readout = Readout { seconds: 0.04, direction: ReadoutDirection::TopToBottom, middle: -0.01 };

/// Whether a folder is a sequence.
pub(super) fn is_of(folder: &Path) -> bool {
    let lidar = folder.join("lidar");
    lidar.join("poses.json").is_file() && entries(&lidar, &FRAME_ENDINGS).is_ok_and(|names| !names.is_empty())
}

/// Whether a folder holds some of a sequence.
pub(super) fn resembles(folder: &Path) -> bool {
    let of_lidar = entries(&folder.join("lidar"), &FRAME_ENDINGS).is_ok_and(|names| !names.is_empty());
    of_lidar || folder.join("lidar/poses.json").is_file() || folder.join(CUBOIDS).is_dir()
}

/// The frames of a sequence.
pub(super) fn read(folder: &Path, selection: &Selection) -> Result<Source> {
    let sweeps = Sensor::read(folder, "lidar", &FRAME_ENDINGS)?;
    let (mut names, mut cameras) = (Vec::new(), Vec::new());
    for name in folders(&folder.join("camera")).unwrap_or_default() {
        let files = entries(&folder.join("camera").join(&name), &IMAGE_ENDINGS)?;
        if files.is_empty() {
            continue;
        }
        if selection.camera(&name) {
            cameras.push(Images::read(folder, &name)?);
        }
        names.push(name);
    }
    let taken = lidars::wanted(selection);
    let lidar_from_sensor = lidars::mounts(&taken);
    let boxes = numbered(&folder.join(CUBOIDS), &FRAME_ENDINGS).unwrap_or_default();
    let frame = |(index, file): (usize, &Numbered)| {
        let file_of_sweep = Path::new("lidar").join(&file.name);
        let mut lidar = LidarRecord::new(file_of_sweep.clone(), sweeps.times[index], sweeps.pose(index)?);
        lidar.returns.sensors =
            Some(SensorsRecord { file: file_of_sweep, lidar_from_sensor: lidar_from_sensor.clone() });
        let cameras = cameras.iter().filter_map(|images| images.record(file.number).transpose());
        let place = boxes.binary_search_by_key(&file.number, |b| b.number).ok();
        let boxes = place.map(|place| cuboids(&folder.join(CUBOIDS).join(&boxes[place].name)));
        Ok(Frame { lidar, cameras: cameras.collect::<Result<_>>()?, boxes: boxes.transpose()? })
    };
    Ok(Source {
        root: folder.to_owned(),
        name: format!("pandaset_{}", folder_name(folder)),
        source: format!("PandaSet, sequence {}", folder_name(folder)),
        licence: "PandaSet terms of use".to_owned(),
        frames: sweeps.files.iter().enumerate().map(frame).collect(),
        cameras: names,
        lidars: lidars::names(),
        decoder: Arc::new(Decoder { taken }),
    })
}

#[derive(Clone, Copy, Debug, Deserialize)]
struct PoseJson {
    position: Vector,
    heading: Quaternion,
}

#[derive(Clone, Copy, Debug, Deserialize)]
struct Vector {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Clone, Copy, Debug, Deserialize)]
struct Quaternion {
    w: f64,
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Clone, Copy, Debug, Deserialize)]
struct IntrinsicsJson {
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
}

/// A folder of files with a pose and a moment each.
struct Sensor {
    poses_file: PathBuf,
    files: Vec<Numbered>,
    poses: Vec<PoseJson>,
    times: Vec<f64>,
}

impl Sensor {
    fn read(folder: &Path, name: &str, endings: &[&str]) -> Result<Self> {
        let place = folder.join(name);
        let files = numbered(&place, endings)?;
        let (poses_file, times_file) = (place.join("poses.json"), place.join("timestamps.json"));
        let poses: Vec<PoseJson> = read_json(&poses_file)?;
        let times: Vec<f64> = read_json(&times_file)?;
        let (poses, times) = (of_files(&files, poses), of_files(&files, times));
        match (poses, times) {
            (Ok(poses), Ok(times)) => Ok(Self { poses_file, files, poses, times }),
            (Err(found), _) => Err(Self::entries(&poses_file, name, files.len(), found)),
            (_, Err(found)) => Err(Self::entries(&times_file, name, files.len(), found)),
        }
    }

    fn entries(file: &Path, name: &str, count: usize, found: usize) -> FormatError {
        let expected = format!("one entry for each of the {count} files of `{name}`, or for each of their numbers");
        FormatError::invalid(file, "entries", expected, found.to_string())
    }

    fn pose(&self, index: usize) -> Result<Pose> {
        let PoseJson { position: p, heading: h } = self.poses[index];
        let at = At { file: &self.poses_file, field: &format!("[{index}]") };
        at.pose([h.w, h.x, h.y, h.z], [p.x, p.y, p.z])
    }
}

/// The entries of files: as many as files, in their order, or else by their numbers, where some files were not fetched.
///
/// # Errors
/// How many entries there are, where they are neither.
fn of_files<T: Clone>(files: &[Numbered], entries: Vec<T>) -> std::result::Result<Vec<T>, usize> {
    if entries.len() == files.len() {
        return Ok(entries);
    }
    let entry = |file: &Numbered| usize::try_from(file.number).ok().and_then(|number| entries.get(number)).cloned();
    files.iter().map(entry).collect::<Option<Vec<T>>>().ok_or(entries.len())
}

/// The images of a camera.
struct Images {
    name: String,
    sensor: Sensor,
    intrinsics: IntrinsicsJson,
    size: [u32; 2],
}

impl Images {
    fn read(folder: &Path, name: &str) -> Result<Self> {
        let place = format!("camera/{name}");
        let sensor = Sensor::read(folder, &place, &IMAGE_ENDINGS)?;
        let intrinsics = read_json(&folder.join(&place).join("intrinsics.json"))?;
        let size = match sensor.files.first() {
            Some(file) => crate::image::dimensions(&folder.join(&place).join(&file.name))?,
            None => [0, 0],
        };
        Ok(Self { name: name.to_owned(), sensor, intrinsics, size })
    }

    fn record(&self, number: u64) -> Result<Option<CameraRecord>> {
        let Ok(index) = self.sensor.files.binary_search_by_key(&number, |file| file.number) else { return Ok(None) };
        let IntrinsicsJson { fx, fy, cx, cy } = self.intrinsics;
        let [width, height] = self.size;
        let camera = Camera {
            name: self.name.clone(),
            timestamp: self.sensor.times[index],
            width,
            height,
            intrinsics: Intrinsics { fx, fy, cx: cx + 0.5, cy: cy + 0.5 },
            distortion: None,
            readout: Some(SHUTTER),
            world_from_camera: self.sensor.pose(index)?,
        };
        let file = PathBuf::from(format!("camera/{}/{}", self.name, self.sensor.files[index].name));
        Ok(Some(CameraRecord { file, mask: None, depth: None, camera }))
    }
}

/// The boxes of a frame. A cuboid's length lies along its own y: its x points to the right of its direction.
fn cuboids(file: &Path) -> Result<Vec<TrackedBox>> {
    let table = read_frame(file)?;
    let names = ["position.x", "position.y", "position.z", "dimensions.x", "dimensions.y", "dimensions.z", "yaw"];
    let seen_by = if table.has("cuboids.sensor_id") { Some(table.ints("cuboids.sensor_id")?) } else { None };
    let mut boxes = Vec::new();
    for (row, [x, y, z, width, length, height, angle]) in table.rows(names)?.into_iter().enumerate() {
        if seen_by.is_some_and(|seen_by| seen_by[row] == PANDAR_GT) {
            continue;
        }
        boxes.push(TrackedBox {
            track: table.text("uuid", row)?.to_owned(),
            category: table.text("label", row)?.to_owned(),
            size: [length, width, height],
            world_from_box: Pose::new(yaw(angle + std::f64::consts::FRAC_PI_2), DVec3::new(x, y, z)),
        });
    }
    Ok(boxes)
}

/// Sweeps in frames of pandas, in the world.
#[derive(Debug)]
struct Decoder {
    /// `d` of the `LiDARs` that are taken; a return's index is the place in this list.
    taken: Vec<i64>,
}

impl Decode for Decoder {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "metres and intensities of a sensor, kept as f32 by the format"
    )]
    fn decode(&self, path: &Path, record: &LidarRecord) -> Result<Sweep> {
        let table = read_frame(path)?;
        let lidar_from_world = record.world_from_lidar.inverse();
        let rows = table.rows(["x", "y", "z", "i"])?;
        let own = if table.has("d") { table.ints("d")?.to_vec() } else { vec![PANDAR64; rows.len()] };
        let sensor = |row: usize| (0_u8..).zip(&self.taken).find(|(_, d)| **d == own[row]).map(|(index, _)| index);
        let is_kept = |row: usize| sensor(row).is_some();
        let kept = rows.into_iter().enumerate().filter(|(row, _)| is_kept(*row));
        let place = |(_, [x, y, z, intensity]): (usize, [f64; 4])| {
            let p = lidar_from_world.transform_point(DVec3::new(x, y, z));
            [p.x, p.y, p.z, intensity].map(|value| value as f32)
        };
        let sensors = (0..own.len()).filter_map(sensor).collect();
        let sweep = Sweep { sensors: Some(sensors), ..Sweep::of_rows(path, kept.map(place))? };
        if !table.has("t") {
            return Ok(sweep);
        }
        let moments = table.floats("t")?;
        let moments = moments.iter().enumerate().filter(|(row, _)| is_kept(*row));
        sweep.with_times(path, moments.map(|(_, moment)| moment - record.timestamp))
    }
}
