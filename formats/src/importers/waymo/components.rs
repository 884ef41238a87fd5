//! The second form: a Parquet file a component and drive, in folders named after the components.
//!
//! # Source
//! waymo-research/waymo-open-dataset, `v2/perception` and `v2/component.py`: the names of the columns.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use super::{
    drive::Store,
    snapshot::{
        CameraMount, Image, Inclinations, Label, Laser, LaserMount, RangeImage, Sensor, Shutter, Snapshot, direction,
        pose_of,
    },
};
use crate::{
    error::{FormatError, Result},
    importers::parquet::ParquetFile,
    pose::Pose,
};

/// Folders of the components.
pub(super) const LIDAR: &str = "lidar";
pub(super) const VEHICLE_POSE: &str = "vehicle_pose";
const LIDAR_POSE: &str = "lidar_pose";
const LIDAR_CALIBRATION: &str = "lidar_calibration";
const LIDAR_BOX: &str = "lidar_box";
const CAMERA_IMAGE: &str = "camera_image";
const CAMERA_CALIBRATION: &str = "camera_calibration";
/// What the frames of all components are joined by.
const TIMESTAMP: &str = "key.frame_timestamp_micros";

/// The components of a drive.
#[derive(Debug)]
pub(super) struct Components {
    /// `lidar/NAME.parquet` and `camera_image/NAME.parquet`.
    sweeps: PathBuf,
    images: PathBuf,
    lidar: ParquetFile,
    poses: Option<ParquetFile>,
    camera: Option<ParquetFile>,
}

/// Where an image or a range image is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    Image { row: u64 },
    Returns { row: u64, which: usize },
    Poses { row: u64 },
}

/// Rows of a component by their frame.
type ByFrame<T> = BTreeMap<i64, Vec<T>>;

impl Components {
    /// The components of the drive `name` in `folder`, and its frames: those with range images.
    ///
    /// # Errors
    /// A component that is missing, damaged, or lacks a column.
    pub(super) fn read(folder: &Path, name: &str) -> Result<(Self, Vec<Result<Snapshot<Place>>>)> {
        let file = |component: &str| Path::new(component).join(format!("{name}.parquet"));
        let open = |component: &str| ParquetFile::open(&folder.join(file(component)));
        let optional =
            |component: &str| Some(component).filter(|c| folder.join(file(c)).exists()).map(open).transpose();
        let components = Self {
            sweeps: file(LIDAR),
            images: file(CAMERA_IMAGE),
            lidar: open(LIDAR)?,
            poses: optional(LIDAR_POSE)?,
            camera: optional(CAMERA_IMAGE)?,
        };
        let cameras = match optional(CAMERA_CALIBRATION)? {
            Some(table) => camera_mounts(&table)?,
            None => Vec::new(),
        };
        let mounts = laser_mounts(&open(LIDAR_CALIBRATION)?)?;
        let vehicle = open(VEHICLE_POSE)?;
        let mut images = components.camera.as_ref().map_or(Ok(BTreeMap::new()), images)?;
        let mut labels = optional(LIDAR_BOX)?.map(|table| labels(&table)).transpose()?;
        let mut lasers = components.lasers()?;
        let vehicles: BTreeMap<i64, u64> = frames(&vehicle)?.into_iter().map(|(row, time)| (time, row)).collect();
        let mut snapshots = Vec::with_capacity(lasers.len());
        while let Some((timestamp_micros, lasers)) = lasers.pop_first() {
            let pose = vehicles.get(&timestamp_micros).ok_or_else(|| {
                let expected = format!("a pose of the frame {timestamp_micros}");
                FormatError::invalid(vehicle.path(), TIMESTAMP, expected, "none")
            });
            let pose = pose.and_then(|&row| transform(&vehicle, "[VehiclePoseComponent].world_from_vehicle", row));
            snapshots.push(pose.map(|world_from_vehicle| Snapshot {
                timestamp_micros,
                world_from_vehicle,
                cameras: cameras.clone(),
                mounts: mounts.clone(),
                images: images.remove(&timestamp_micros).unwrap_or_default(),
                lasers,
                labels: labels.as_mut().map(|labels| labels.remove(&timestamp_micros).unwrap_or_default()),
            }));
        }
        Ok((components, snapshots))
    }

    /// The range images of each frame.
    fn lasers(&self) -> Result<ByFrame<Laser<Place>>> {
        let poses: BTreeMap<(i64, i64), u64> = match &self.poses {
            Some(table) => {
                let lasers = table.ints("key.laser_name")?;
                let key = |(row, time): (u64, i64)| Some(((time, at(&lasers, row)?), row));
                frames(table)?.into_iter().filter_map(key).collect()
            }
            None => BTreeMap::new(),
        };
        let names = self.lidar.ints("key.laser_name")?;
        let mut lasers = ByFrame::new();
        for (row, time) in frames(&self.lidar)? {
            let number = at(&names, row).unwrap_or(0);
            let Some(sensor) = Sensor::laser(number) else { continue };
            let returns = [0, 1].map(|which| Some(Place::Returns { row, which }));
            let poses = poses.get(&(time, number)).map(|&row| Place::Poses { row });
            lasers.entry(time).or_insert_with(Vec::new).push(Laser { sensor, returns, poses });
        }
        Ok(lasers)
    }
}

/// The value of a column in a row.
fn at<T: Clone>(values: &[Option<T>], row: u64) -> Option<T> {
    values.get(usize::try_from(row).ok()?).cloned().flatten()
}

/// The rows of a component that are of a frame, and the frame of each.
fn frames(table: &ParquetFile) -> Result<Vec<(u64, i64)>> {
    Ok((0..).zip(table.ints(TIMESTAMP)?).filter_map(|(row, time)| Some((row, time?))).collect())
}

fn transform(table: &ParquetFile, name: &str, row: u64) -> Result<Pose> {
    let name = format!("{name}.transform");
    let numbers = table.numbers(&name, row)?;
    pose_of(table.path(), || format!("{name}[{row}]"), &numbers)
}

/// Columns of numbers, side by side: the numbers of a row where all are there.
struct Numbers<'a, const K: usize> {
    table: &'a ParquetFile,
    names: [String; K],
    columns: Vec<Vec<Option<f64>>>,
}

impl<'a, const K: usize> Numbers<'a, K> {
    fn read(table: &'a ParquetFile, component: &str, names: [&str; K]) -> Result<Self> {
        let names = names.map(|name| format!("[{component}].{name}"));
        let columns = names.iter().map(|name| table.floats(name)).collect::<Result<_>>()?;
        Ok(Self { table, names, columns })
    }

    fn of(&self, row: u64) -> Result<[f64; K]> {
        let mut numbers = [0.0; K];
        for ((number, column), name) in numbers.iter_mut().zip(&self.columns).zip(&self.names) {
            *number = at(column, row)
                .ok_or_else(|| FormatError::invalid(self.table.path(), format!("{name}[{row}]"), "a number", "none"))?;
        }
        Ok(numbers)
    }
}

fn camera_mounts(table: &ParquetFile) -> Result<Vec<CameraMount>> {
    const COMPONENT: &str = "CameraCalibrationComponent";
    let column = |name: &str| table.ints(&format!("[{COMPONENT}].{name}"));
    let names = table.ints("key.camera_name")?;
    let (widths, heights, ways) = (column("width")?, column("height")?, column("rolling_shutter_direction")?);
    let intrinsics = ["f_u", "f_v", "c_u", "c_v", "k1", "k2", "p1", "p2", "k3"].map(|name| format!("intrinsic.{name}"));
    let intrinsics = Numbers::read(table, COMPONENT, intrinsics.each_ref().map(String::as_str))?;
    let mut mounts = Vec::new();
    for (row, name) in (0..).zip(&names) {
        let Some(sensor) = name.and_then(Sensor::camera) else { continue };
        let side = |sides: &[Option<i64>], what: &str| {
            let found = at(sides, row);
            found.and_then(|side| u32::try_from(side).ok()).ok_or_else(|| {
                let found = found.map_or_else(|| "none".to_owned(), |side| side.to_string());
                FormatError::invalid(table.path(), format!("[{COMPONENT}].{what}[{row}]"), "a number of pixels", found)
            })
        };
        mounts.push(CameraMount {
            sensor,
            intrinsic: intrinsics.of(row)?,
            vehicle_from_camera: transform(table, &format!("[{COMPONENT}].extrinsic"), row)?,
            size: [side(&widths, "width")?, side(&heights, "height")?],
            direction: at(&ways, row).and_then(direction),
        });
    }
    Ok(mounts)
}

fn laser_mounts(table: &ParquetFile) -> Result<Vec<LaserMount>> {
    const COMPONENT: &str = "LiDARCalibrationComponent";
    let names = table.ints("key.laser_name")?;
    let ends = Numbers::read(table, COMPONENT, ["beam_inclination.min", "beam_inclination.max"])?;
    let mut mounts = Vec::new();
    for (row, name) in (0..).zip(&names) {
        let Some(sensor) = name.and_then(Sensor::laser) else { continue };
        let beams = table.numbers(&format!("[{COMPONENT}].beam_inclination.values"), row)?;
        mounts.push(LaserMount {
            sensor,
            vehicle_from_laser: transform(table, &format!("[{COMPONENT}].extrinsic"), row)?,
            inclinations: match beams.is_empty() {
                false => Inclinations::Each(beams),
                true => Inclinations::Between(ends.of(row)?),
            },
        });
    }
    Ok(mounts)
}

/// The images of each frame.
fn images(table: &ParquetFile) -> Result<ByFrame<Image<Place>>> {
    const COMPONENT: &str = "CameraImageComponent";
    let names = table.ints("key.camera_name")?;
    let times = Numbers::read(table, COMPONENT, ["pose_timestamp"])?;
    let shutter = ["shutter", "camera_trigger_time", "camera_readout_done_time"];
    let shutter = shutter.map(|name| format!("rolling_shutter_params.{name}"));
    let shutters = Numbers::read(table, COMPONENT, shutter.each_ref().map(String::as_str))?;
    let mut images = ByFrame::new();
    for (row, time) in frames(table)? {
        let Some(sensor) = at(&names, row).and_then(Sensor::camera) else { continue };
        let [pose_timestamp] = times.of(row)?;
        let [exposure, trigger, done] = shutters.of(row)?;
        images.entry(time).or_insert_with(Vec::new).push(Image {
            sensor,
            file: Place::Image { row },
            world_from_vehicle: transform(table, &format!("[{COMPONENT}].pose"), row)?,
            pose_timestamp,
            shutter: Some(Shutter { exposure, trigger, done }),
        });
    }
    Ok(images)
}

/// The boxes of each frame.
fn labels(table: &ParquetFile) -> Result<ByFrame<Label>> {
    const COMPONENT: &str = "LiDARBoxComponent";
    let (ids, kinds) = (table.texts("key.laser_object_id")?, table.ints(&format!("[{COMPONENT}].type"))?);
    let columns = ["center.x", "center.y", "center.z", "size.x", "size.y", "size.z", "heading"];
    let columns = columns.map(|name| format!("box.{name}"));
    let boxes = Numbers::read(table, COMPONENT, columns.each_ref().map(String::as_str))?;
    let mut labels = ByFrame::new();
    for (row, time) in frames(table)? {
        let [x, y, z, length, width, height, heading] = boxes.of(row)?;
        labels.entry(time).or_insert_with(Vec::new).push(Label {
            id: at(&ids, row).unwrap_or_default(),
            kind: at(&kinds, row).unwrap_or(0),
            centre: [x, y, z],
            size: [length, width, height],
            heading,
        });
    }
    Ok(labels)
}

impl Store for Components {
    type Place = Place;

    fn sweeps(&self) -> &Path {
        &self.sweeps
    }

    fn images(&self) -> &Path {
        &self.images
    }

    fn image(&self, _name: &str, place: &Place) -> Result<Vec<u8>> {
        let (Some(table), &Place::Image { row }) = (&self.camera, place) else { return Ok(Vec::new()) };
        Ok(table.bytes("[CameraImageComponent].image", row)?.unwrap_or_default())
    }

    fn range_image(&self, _name: &str, place: &Place) -> Result<Option<RangeImage>> {
        let (table, column, row) = match *place {
            Place::Returns { row, which: 0 } => (Some(&self.lidar), "[LiDARComponent].range_image_return1", row),
            Place::Returns { row, .. } => (Some(&self.lidar), "[LiDARComponent].range_image_return2", row),
            Place::Poses { row } => (self.poses.as_ref(), "[LiDARPoseComponent].range_image_return1", row),
            Place::Image { .. } => return Ok(None),
        };
        let Some(table) = table else { return Ok(None) };
        let values = table.numbers(&format!("{column}.values"), row)?;
        if values.is_empty() {
            return Ok(None);
        }
        let dims: Vec<i64> = table.numbers(&format!("{column}.shape"), row)?.into_iter().map(whole).collect();
        let values = values.into_iter().map(single).collect();
        let image = RangeImage::new(&dims, values).map_err(|found| {
            FormatError::invalid(table.path(), format!("{column}[{row}]"), "a matrix of three dimensions", found)
        })?;
        Ok(Some(image))
    }
}

#[expect(clippy::cast_possible_truncation, reason = "what is no side of an image becomes none")]
const fn whole(side: f64) -> i64 {
    side as i64
}

#[expect(clippy::cast_possible_truncation, reason = "stored as f32")]
const fn single(value: f64) -> f32 {
    value as f32
}
