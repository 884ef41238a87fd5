//! nuScenes: the JSON tables of a release (`v1.0-*/`), keyframes under `samples/`, what lies between under `sweeps/`.
//!
//! Every revolution of the LiDAR is a frame, with the images that are nearest to it; boxes between keyframes lie on the way
//! from one to the other.
//!
//! # Source
//! nutonomy/nuscenes-devkit, `docs/schema_nuscenes.md` and `python-sdk/nuscenes/nuscenes.py`. Images are undistorted
//! already (its issue 120). Principal points count from the centre of the first pixel: half a pixel is added.

mod scenes;
mod tables;
mod tracks;

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
    sync::Arc,
};

use scenes::Chosen;
use tables::{CalibratedSensor, EgoPose, Sample, SampleData, Sensor, read_table};
use tracks::Tracks;

use super::{
    Selection, Source,
    nearest::{Shot, image_of_each},
    values::{At, folders, inside},
};
use crate::{
    camera::{Camera, Intrinsics},
    clip::{CameraRecord, Frame, LidarRecord},
    clip_dir::Decode,
    error::{FormatError, Result},
    pose::Pose,
    read::{MAX_DATA_BYTES, read_file},
    sweep::Sweep,
};

/// The channel of the sweeps.
const LIDAR: &str = "LIDAR_TOP";
/// Farthest that an image may be from its sweep, seconds: a keyframe has images of the whole revolution before it.
const REACH: f64 = 0.06;
/// f32 values of a return: x, y, z, intensity, ring.
const RETURN_VALUES: usize = 5;

/// Whether a folder is a release.
pub(super) fn is_of(folder: &Path) -> bool {
    scenes::versions(folder).is_ok_and(|versions| !versions.is_empty())
}

/// Whether a folder holds some of a release.
pub(super) fn resembles(folder: &Path) -> bool {
    let of_version = |names: Vec<String>| names.iter().any(|name| name.starts_with("v1.0-"));
    folder.join("sample_data.json").is_file()
        || folders(folder).is_ok_and(of_version)
        || [LIDAR, "CAM_FRONT"].iter().any(|name| folder.join("samples").join(name).is_dir())
}

/// Names of the scenes of a release.
pub(super) fn scenes(folder: &Path) -> Result<Vec<String>> {
    scenes::names(folder)
}

/// The frames of one scene of a release.
pub(super) fn read(folder: &Path, selection: &Selection) -> Result<Source> {
    let Chosen { tables, scene } = scenes::choose(folder, selection.scene.as_deref())?;
    let mut samples: Vec<Sample> =
        read_table(&tables.join("sample.json"), |sample: &Sample| sample.scene_token == scene.token)?;
    samples.sort_by_key(|sample| sample.timestamp);
    let reader = Reader::new(folder, &tables, &samples)?;
    let shots = reader.shots()?;
    let tracks = Tracks::read(&tables, &samples)?;
    let no_sweeps = || FormatError::invalid(&reader.file, LIDAR, format!("sweeps of {}", scene.name), "none");
    let sweeps = shots.get(LIDAR).ok_or_else(no_sweeps)?;
    let times: Vec<f64> = sweeps.iter().map(|shot| seconds(shot.timestamp)).collect();
    let images: BTreeMap<&str, Vec<Option<usize>>> = shots
        .iter()
        .filter(|(channel, _)| channel.as_str() != LIDAR)
        .map(|(channel, images)| {
            let shot = |(image, data): (usize, &&SampleData)| Shot { image, time: seconds(data.timestamp) };
            let moments: Vec<Shot> = images.iter().enumerate().map(shot).collect();
            (channel.as_str(), image_of_each(&times, &moments, REACH))
        })
        .collect();
    let has_images = |sweep: usize| images.values().any(|of_each| of_each[sweep].is_some());
    let any_images = (0..sweeps.len()).any(has_images);
    let frame = |sweep: usize| {
        let data = sweeps[sweep];
        let placed = reader.placed(data)?;
        let lidar = LidarRecord::new(placed.file, seconds(data.timestamp), placed.world_from_sensor);
        let wanted = images.iter().filter(|(channel, _)| selection.camera(channel));
        let own = wanted.filter_map(|(channel, of_each)| Some((*channel, shots[*channel][of_each[sweep]?])));
        let cameras = own.map(|(channel, data)| reader.camera(channel, data)).collect::<Result<_>>()?;
        Ok(Frame { lidar, cameras, boxes: tracks.at(data.timestamp) })
    };
    Ok(Source {
        root: folder.to_owned(),
        name: format!("nuscenes_{}", scene.name),
        source: format!("nuScenes {}, {}", super::folder_name(&tables), scene.name),
        licence: "CC BY-NC-SA 4.0 and the nuScenes terms of use".to_owned(),
        frames: (0..sweeps.len()).filter(|&sweep| has_images(sweep) || !any_images).map(frame).collect(),
        cameras: images.keys().map(|&channel| channel.to_owned()).collect(),
        lidars: Vec::new(),
        decoder: Arc::new(Decoder),
    })
}

/// Seconds of a count of microseconds.
#[expect(clippy::cast_precision_loss, reason = "microseconds since 1970 are below 2^53")]
fn seconds(microseconds: i64) -> f64 {
    microseconds as f64 / 1e6
}

/// The tables of one scene by their tokens.
struct Reader<'a> {
    folder: &'a Path,
    /// The table that errors name.
    file: PathBuf,
    data: Vec<SampleData>,
    poses: BTreeMap<String, EgoPose>,
    mounts: BTreeMap<String, CalibratedSensor>,
    sensors: BTreeMap<String, Sensor>,
}

/// Where a file is and from where it was taken.
struct Placed {
    file: PathBuf,
    world_from_sensor: Pose,
}

impl<'a> Reader<'a> {
    fn new(folder: &'a Path, tables: &Path, samples: &[Sample]) -> Result<Self> {
        let tokens: BTreeSet<&str> = samples.iter().map(|sample| sample.token.as_str()).collect();
        let file = tables.join("sample_data.json");
        let data: Vec<SampleData> = read_table(&file, |data: &SampleData| tokens.contains(data.sample_token.as_str()))?;
        let used: BTreeSet<&str> = data.iter().map(|data| data.ego_pose_token.as_str()).collect();
        let poses: Vec<EgoPose> =
            read_table(&tables.join("ego_pose.json"), |pose: &EgoPose| used.contains(pose.token.as_str()))?;
        let mounts: Vec<CalibratedSensor> = read_table(&tables.join("calibrated_sensor.json"), |_| true)?;
        let sensors: Vec<Sensor> = read_table(&tables.join("sensor.json"), |_| true)?;
        Ok(Self {
            folder,
            file,
            data,
            poses: poses.into_iter().map(|pose| (pose.token.clone(), pose)).collect(),
            mounts: mounts.into_iter().map(|mount| (mount.token.clone(), mount)).collect(),
            sensors: sensors.into_iter().map(|sensor| (sensor.token.clone(), sensor)).collect(),
        })
    }

    fn missing(&self, data: &SampleData, key: &str, token: &str) -> FormatError {
        FormatError::invalid(&self.file, format!("{}: {key}", data.token), "a token of its table", format!("`{token}`"))
    }

    fn mount(&self, data: &SampleData) -> Result<&CalibratedSensor> {
        let token = &data.calibrated_sensor_token;
        self.mounts.get(token).ok_or_else(|| self.missing(data, "calibrated_sensor_token", token))
    }

    /// Sweeps and images by channel, by time; between keyframes only those whose files are there.
    fn shots(&self) -> Result<BTreeMap<String, Vec<&SampleData>>> {
        let mut shots: BTreeMap<String, Vec<&SampleData>> = BTreeMap::new();
        for data in &self.data {
            let token = &self.mount(data)?.sensor_token;
            let sensor = self.sensors.get(token).ok_or_else(|| self.missing(data, "sensor_token", token))?;
            let wanted = sensor.channel == LIDAR || sensor.modality == "camera";
            if wanted && (data.is_key_frame || self.folder.join(&data.filename).is_file()) {
                shots.entry(sensor.channel.clone()).or_default().push(data);
            }
        }
        for data in shots.values_mut() {
            data.sort_by_key(|data| data.timestamp);
            data.dedup_by_key(|data| data.timestamp);
        }
        Ok(shots)
    }

    fn placed(&self, data: &SampleData) -> Result<Placed> {
        let at = |field: &str| format!("{}: {field}", data.token);
        let mount = self.mount(data)?;
        let token = &data.ego_pose_token;
        let pose = self.poses.get(token).ok_or_else(|| self.missing(data, "ego_pose_token", token))?;
        let world_from_vehicle =
            At { file: &self.file, field: &at("ego pose") }.pose(pose.rotation, pose.translation)?;
        let vehicle_from_sensor =
            At { file: &self.file, field: &at("calibrated sensor") }.pose(mount.rotation, mount.translation)?;
        let file = inside(At { file: &self.file, field: &at("filename") }, &data.filename)?;
        Ok(Placed { file, world_from_sensor: world_from_vehicle * vehicle_from_sensor })
    }

    fn camera(&self, channel: &str, data: &SampleData) -> Result<CameraRecord> {
        let Placed { file, world_from_sensor } = self.placed(data)?;
        let rows: Option<[[f64; 3]; 3]> = self.mount(data)?.pinhole();
        let Some([[fx, _, cx], [_, fy, cy], _]) = rows else {
            let field = format!("{}: camera_intrinsic", data.token);
            return Err(FormatError::invalid(&self.file, field, "3 rows of 3 numbers, without skew", "others"));
        };
        let camera = Camera {
            name: channel.to_owned(),
            timestamp: seconds(data.timestamp),
            width: data.width,
            height: data.height,
            intrinsics: Intrinsics { fx, fy, cx: cx + 0.5, cy: cy + 0.5 },
            distortion: None,
            readout: None,
            world_from_camera: world_from_sensor,
        };
        Ok(CameraRecord { file, mask: None, depth: None, camera })
    }
}

/// Sweeps in `.pcd.bin` files: little-endian f32 `x, y, z, intensity, ring`.
#[derive(Debug)]
struct Decoder;

impl Decode for Decoder {
    fn decode(&self, path: &Path, _record: &LidarRecord) -> Result<Sweep> {
        let bytes = read_file(path, MAX_DATA_BYTES)?;
        let (values, rest) = bytes.as_chunks::<4>();
        let (rows, left) = values.as_chunks::<RETURN_VALUES>();
        if !rest.is_empty() || !left.is_empty() {
            let found = format!("{} bytes (truncated?)", bytes.len());
            let expected = "a multiple of 20 bytes (x, y, z, intensity, ring)";
            return Err(FormatError::invalid(path, "file size", expected, found));
        }
        let value = |row: &[[u8; 4]; RETURN_VALUES], k: usize| f32::from_le_bytes(row[k]);
        Sweep::of_rows(path, rows.iter().map(|row| [0, 1, 2, 3].map(|k| value(row, k))))
    }
}
