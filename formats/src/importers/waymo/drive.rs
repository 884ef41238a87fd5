//! Frames of a clip from those of a drive, and what lies inside its files.

use std::{
    collections::BTreeMap,
    fmt::Debug,
    path::{Path, PathBuf},
};

use glam::{DMat3, DVec3};

use super::{
    returns::{Frames, Returns, TURN},
    snapshot::{CameraMount, Image, Laser, LaserMount, RangeImage, Shutter, Snapshot},
};
use crate::{
    camera::{Camera, Distortion, Intrinsics, Readout, ReadoutDirection},
    clip::{CameraRecord, Frame, LidarRecord, ReturnsRecord, SensorsRecord, TrackedBox},
    clip_dir::Decode,
    error::{FormatError, Result},
    importers::{Selection, values::yaw},
    pose::Pose,
    sweep::Sweep,
};

/// The files of a drive; `Place` says where an image or a range image is in them.
pub(super) trait Store: Debug + Send + Sync {
    type Place: Clone + Debug + Send + Sync;

    /// The file of the sweeps, relative to the clip's root.
    fn sweeps(&self) -> &Path;

    /// The file of the images, relative to the clip's root.
    fn images(&self) -> &Path;

    /// The content of an image file; `name` is what errors call it.
    ///
    /// # Errors
    /// What is damaged.
    fn image(&self, name: &str, place: &Self::Place) -> Result<Vec<u8>>;

    /// A range image; `None` where the drive has none.
    ///
    /// # Errors
    /// What is damaged, or no range image.
    fn range_image(&self, name: &str, place: &Self::Place) -> Result<Option<RangeImage>>;
}

/// A drive whose sweeps and images are read when somebody asks for them.
#[derive(Debug)]
pub(super) struct Drive<S: Store> {
    store: S,
    sweeps: BTreeMap<PathBuf, Lasers<S::Place>>,
    images: BTreeMap<PathBuf, S::Place>,
}

/// The range images of a sweep.
#[derive(Debug)]
struct Lasers<P> {
    /// Those of a sensor, by its index in the clip.
    lasers: Vec<(u8, LaserMount, Laser<P>)>,
    frames: Frames,
    /// Seconds from the sweep's timestamp to the first shot.
    start: f64,
}

impl<S: Store> Drive<S> {
    pub(super) const fn new(store: S) -> Self {
        Self { store, sweeps: BTreeMap::new(), images: BTreeMap::new() }
    }

    /// The frame `index` of the clip; from now on its sweep and its images can be read.
    ///
    /// # Errors
    /// Calibrations that are missing; `file` is what errors name.
    pub(super) fn frame(
        &mut self,
        file: &Path,
        index: usize,
        snapshot: &Snapshot<S::Place>,
        selection: &Selection,
    ) -> Result<Frame> {
        let error = |field: &str, expected: String, found: String| {
            Err(FormatError::invalid(file, format!("frame {index}: {field}"), expected, found))
        };
        let mut mounts: Vec<&LaserMount> =
            snapshot.mounts.iter().filter(|m| selection.lidar(m.sensor.name())).collect();
        mounts.sort_by_key(|mount| mount.sensor);
        mounts.dedup_by_key(|mount| mount.sensor);
        let Some(first) = mounts.first() else {
            let known: Vec<&str> = snapshot.mounts.iter().map(|mount| mount.sensor.name()).collect();
            let wanted = selection.lidars.as_ref().map_or_else(|| "any LiDAR".to_owned(), |names| names.join(", "));
            return error("laser_calibrations", wanted, format!("`{}`", known.join("`, `")));
        };
        // Only the place of the first sensor: with the vehicle's axes x is forward.
        let vehicle_from_lidar = Pose::new(DMat3::IDENTITY, first.vehicle_from_laser.translation());
        let lidar_from_vehicle = vehicle_from_lidar.inverse();
        let mut lasers = Vec::new();
        for (sensor, mount) in (0_u8..).zip(&mounts) {
            let mut own = snapshot.lasers.iter().filter(|laser| laser.sensor == mount.sensor);
            lasers.extend(own.next().map(|laser| (sensor, (*mount).clone(), laser.clone())));
            if own.next().is_some() {
                return error("lasers", format!("one of {}", mount.sensor), "several".to_owned());
            }
        }
        let is_known = |laser: &&Laser<S::Place>| snapshot.mounts.iter().any(|mount| mount.sensor == laser.sensor);
        if let Some(lost) = snapshot.lasers.iter().find(|laser| !is_known(laser)) {
            return error("laser_calibrations", format!("one of {}", lost.sensor), "none".to_owned());
        }
        let named = |base: &Path, ending: &str| base.join(format!("frame_{index:04}{ending}"));
        let sweep = named(self.store.sweeps(), ".lidar");
        let timestamp = moment_of_pose(snapshot);
        let mut returns = ReturnsRecord::default();
        if mounts.len() > 1 {
            let lidar_from_sensor = mounts.iter().map(|mount| lidar_from_vehicle * mount.vehicle_from_laser).collect();
            returns.sensors = Some(SensorsRecord { file: named(self.store.sweeps(), ".sensors"), lidar_from_sensor });
        }
        let lidar = LidarRecord {
            file: sweep.clone(),
            timestamp,
            world_from_lidar: snapshot.world_from_vehicle * vehicle_from_lidar,
            returns,
        };
        let frames = Frames { world_from_vehicle: snapshot.world_from_vehicle, lidar_from_vehicle };
        self.sweeps.insert(sweep, Lasers { lasers, frames, start: seconds(snapshot.timestamp_micros) - timestamp });
        let mut cameras = Vec::new();
        for image in snapshot.images.iter().filter(|image| selection.camera(image.sensor.name())) {
            let Some(mount) = snapshot.cameras.iter().find(|mount| mount.sensor == image.sensor) else {
                return error("camera_calibrations", format!("one of {}", image.sensor), "none".to_owned());
            };
            let place = named(self.store.images(), &format!("_{}.jpg", image.sensor));
            self.images.insert(place.clone(), image.file.clone());
            cameras.push(CameraRecord { file: place, mask: None, depth: None, camera: camera(mount, image) });
        }
        cameras.sort_by(|a, b| a.camera.name.cmp(&b.camera.name));
        Ok(Frame { lidar, cameras, boxes: boxes(snapshot) })
    }

    fn image_at(&self, file: &Path) -> Option<&S::Place> {
        self.images.get(file)
    }
}

/// Seconds of a count of microseconds.
#[expect(clippy::cast_precision_loss, reason = "microseconds since 1970 are below 2^53")]
pub(super) fn seconds(microseconds: i64) -> f64 {
    microseconds as f64 / 1e6
}

/// When the vehicle was where the pose of the frame says, seconds: the frame's timestamp is that of its first shot, its pose that of the front
/// camera's image about half a turn later. The pose itself tells: it is that of an image, to the last digit of a float.
fn moment_of_pose<P>(snapshot: &Snapshot<P>) -> f64 {
    let middle = seconds(snapshot.timestamp_micros) + TURN / 2.0;
    let own = digits(&snapshot.world_from_vehicle);
    let same = snapshot.images.iter().filter(|image| digits(&image.world_from_vehicle) == own);
    let times = same.map(|image| image.pose_timestamp).filter(|time| (time - middle).abs() < TURN);
    times.min_by(|a, b| (a - middle).abs().total_cmp(&(b - middle).abs())).unwrap_or(middle)
}

/// A pose as single precision has it: one of two files may store it so.
#[expect(clippy::cast_possible_truncation, reason = "what is compared are the digits of a float")]
fn digits(pose: &Pose) -> [[f32; 4]; 4] {
    pose.rows().map(|row| row.map(|value| value as f32))
}

fn camera<P>(mount: &CameraMount, image: &Image<P>) -> Camera {
    // From x right, y down, z forward to x forward, y left, z up.
    let turn = Pose::new(DMat3::from_cols(DVec3::NEG_Y, DVec3::NEG_Z, DVec3::X), DVec3::ZERO);
    let [fx, fy, cx, cy, lens @ ..] = mount.intrinsic;
    let [width, height] = mount.size;
    Camera {
        name: image.sensor.name().to_owned(),
        timestamp: image.pose_timestamp,
        width,
        height,
        // Pixels are counted from the edge of the first one.
        intrinsics: Intrinsics { fx, fy, cx, cy },
        distortion: (lens != [0.0; 5]).then_some(Distortion::BrownConrady(lens)),
        readout: image.shutter.map(|shutter| readout(mount.direction, shutter, image.pose_timestamp)),
        world_from_camera: image.world_from_vehicle * mount.vehicle_from_camera * turn,
    }
}

/// The shutter of an image.
///
/// # Formula
/// The first column is exposed from the trigger on; what comes after its exposure is the readout. Each column counts at the middle of its own.
fn readout(direction: Option<ReadoutDirection>, shutter: Shutter, pose_timestamp: f64) -> Readout {
    let Shutter { exposure, trigger, done } = shutter;
    let seconds = if direction.is_some() { done - trigger - exposure } else { 0.0 };
    let middle = trigger - pose_timestamp + exposure / 2.0 + seconds / 2.0;
    Readout { seconds, direction: direction.unwrap_or(ReadoutDirection::TopToBottom), middle }
}

fn boxes<P>(snapshot: &Snapshot<P>) -> Option<Vec<TrackedBox>> {
    let labels = snapshot.labels.as_ref()?;
    let tracked = labels.iter().map(|label| TrackedBox {
        track: label.id.clone(),
        category: label.category().to_owned(),
        size: label.size,
        world_from_box: snapshot.world_from_vehicle * Pose::new(yaw(label.heading), DVec3::from(label.centre)),
    });
    Some(tracked.collect())
}

impl<S: Store> Decode for Drive<S> {
    fn decode(&self, path: &Path, record: &LidarRecord) -> Result<Sweep> {
        let error = |field: String, expected: &str, found: String| FormatError::invalid(path, field, expected, found);
        let sweep = self.sweeps.get(&record.file);
        let sweep = sweep.ok_or_else(|| error("sweep".to_owned(), "one of the drive", "none".to_owned()))?;
        let mut returns = Returns::default();
        for (sensor, mount, laser) in &sweep.lasers {
            let name = |what: &str| format!("{} {}: {what}", record.file.display(), mount.sensor);
            let load = |what: &str, place: Option<&S::Place>| {
                place.map_or(Ok(None), |place| self.store.range_image(&name(what), place))
            };
            let poses = if mount.sensor.is_top() { load("poses", laser.poses.as_ref())? } else { None };
            for (place, what) in laser.returns.iter().zip(["first returns", "second returns"]) {
                let Some(image) = load(what, place.as_ref())? else { continue };
                let added = returns.add(*sensor, mount, &sweep.frames, &image, poses.as_ref());
                let expected = "range images of [H, W, 4] and poses of [H, W, 6], a row for each beam";
                added.map_err(|found| error(format!("{}: {what}", mount.sensor), expected, found))?;
            }
        }
        let Returns { rows, times, sensors } = returns;
        let found = Sweep::of_rows(path, rows.into_iter())?;
        let found = found.with_times(path, times.into_iter().map(|time| time + sweep.start))?;
        Ok(Sweep { sensors: record.returns.sensors.is_some().then_some(sensors), ..found })
    }

    fn holds(&self, file: &Path) -> bool {
        self.sweeps.contains_key(file) || self.image_at(file).is_some()
    }

    fn image(&self, file: &Path) -> Result<Option<Vec<u8>>> {
        let name = file.display().to_string();
        self.image_at(file).map(|place| self.store.image(&name, place)).transpose()
    }
}
