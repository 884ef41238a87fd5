//! What both forms say of one frame, in the data set's own terms.

use std::fmt;

use crate::{
    camera::ReadoutDirection,
    error::{FormatError, Result},
    pose::Pose,
    read::MAX_DATA_BYTES,
};

/// Names of cameras by their number, from 1.
const CAMERAS: [&str; 8] =
    ["FRONT", "FRONT_LEFT", "FRONT_RIGHT", "SIDE_LEFT", "SIDE_RIGHT", "REAR_LEFT", "REAR", "REAR_RIGHT"];
/// Names of `LiDARs` by their number, from 1.
const LASERS: [&str; 5] = ["TOP", "FRONT", "SIDE_LEFT", "SIDE_RIGHT", "REAR"];
/// What labels are of, by number.
const TYPES: [&str; 5] = ["unknown", "vehicle", "pedestrian", "sign", "cyclist"];
/// Most values of a range image.
const MAX_VALUES: usize = 1 << 26;

/// One of the cameras or of the `LiDARs`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Sensor {
    /// Its number in the data set, from 1, by which sensors are sorted.
    number: i64,
    name: &'static str,
}

impl Sensor {
    /// The camera of a number.
    pub(super) fn camera(number: i64) -> Option<Self> {
        Self::of(&CAMERAS, number)
    }

    /// The `LiDAR` of a number.
    pub(super) fn laser(number: i64) -> Option<Self> {
        Self::of(&LASERS, number)
    }

    fn of(names: &[&'static str], number: i64) -> Option<Self> {
        let index = usize::try_from(number).ok()?.checked_sub(1)?;
        Some(Self { name: names.get(index)?, number })
    }

    pub(super) const fn name(self) -> &'static str {
        self.name
    }

    /// Whether it is the `LiDAR` on the roof.
    pub(super) const fn is_top(self) -> bool {
        self.number == 1
    }
}

impl fmt::Display for Sensor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

/// The names of all cameras.
pub(super) fn camera_names() -> Vec<String> {
    CAMERAS.map(str::to_owned).to_vec()
}

/// The names of all `LiDARs`.
pub(super) fn laser_names() -> Vec<String> {
    LASERS.map(str::to_owned).to_vec()
}

/// A camera on the vehicle.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct CameraMount {
    pub(super) sensor: Sensor,
    /// `[f_u, f_v, c_u, c_v, k1, k2, p1, p2, k3]`.
    pub(super) intrinsic: [f64; 9],
    /// Axes of the camera: x forward, y left, z up.
    pub(super) vehicle_from_camera: Pose,
    pub(super) size: [u32; 2],
    /// Which way the shutter rolls; `None` where it does not.
    pub(super) direction: Option<ReadoutDirection>,
}

/// The way of a shutter by its number; `None` where it does not roll.
pub(super) const fn direction(number: i64) -> Option<ReadoutDirection> {
    match number {
        1 => Some(ReadoutDirection::TopToBottom),
        2 => Some(ReadoutDirection::LeftToRight),
        3 => Some(ReadoutDirection::BottomToTop),
        4 => Some(ReadoutDirection::RightToLeft),
        _ => None,
    }
}

/// A `LiDAR` on the vehicle.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct LaserMount {
    pub(super) sensor: Sensor,
    pub(super) vehicle_from_laser: Pose,
    pub(super) inclinations: Inclinations,
}

/// Angles of the beams above the horizon of the sensor, radians, the lowest beam first.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Inclinations {
    Each(Vec<f64>),
    /// Evenly between these two.
    Between([f64; 2]),
}

/// When an image was taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shutter {
    /// Seconds that a column, or row, is exposed.
    pub(super) exposure: f64,
    /// Epoch at which the first one begins.
    pub(super) trigger: f64,
    /// Epoch at which the last one is read.
    pub(super) done: f64,
}

/// An image; `P` says where its file is.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Image<P> {
    pub(super) sensor: Sensor,
    pub(super) file: P,
    pub(super) world_from_vehicle: Pose,
    /// Epoch of the pose, seconds.
    pub(super) pose_timestamp: f64,
    pub(super) shutter: Option<Shutter>,
}

/// The range images of a `LiDAR`; `P` says where each is.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Laser<P> {
    pub(super) sensor: Sensor,
    /// `[H, W, 4]` range, intensity, elongation, in a zone without labels: of the first and of the second returns.
    pub(super) returns: [Option<P>; 2],
    /// `[H, W, 6]` roll, pitch, yaw, x, y, z of the vehicle in the world, for both returns of each pixel.
    pub(super) poses: Option<P>,
}

/// A labelled box in the vehicle's frame.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Label {
    pub(super) id: String,
    pub(super) kind: i64,
    pub(super) centre: [f64; 3],
    /// Length, width, height.
    pub(super) size: [f64; 3],
    pub(super) heading: f64,
}

impl Label {
    /// What the box is around.
    pub(super) fn category(&self) -> &'static str {
        usize::try_from(self.kind).ok().and_then(|kind| TYPES.get(kind)).unwrap_or(&TYPES[0])
    }
}

/// One frame.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Snapshot<P> {
    /// Epoch of the first shot of the upper `LiDAR`, microseconds.
    pub(super) timestamp_micros: i64,
    pub(super) world_from_vehicle: Pose,
    pub(super) cameras: Vec<CameraMount>,
    pub(super) mounts: Vec<LaserMount>,
    pub(super) images: Vec<Image<P>>,
    pub(super) lasers: Vec<Laser<P>>,
    pub(super) labels: Option<Vec<Label>>,
}

/// A range image, row by row.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct RangeImage {
    /// Rows, columns, values of a pixel.
    pub(super) shape: [usize; 3],
    pub(super) values: Vec<f32>,
}

impl RangeImage {
    /// The image of values of this shape.
    ///
    /// # Errors
    /// In words: a shape of other dimensions, or of another number of values.
    pub(super) fn new(dims: &[i64], values: Vec<f32>) -> std::result::Result<Self, String> {
        let told = || format!("shape {dims:?} of {} values", values.len());
        let sides: Vec<usize> = dims.iter().filter_map(|&side| usize::try_from(side).ok()).collect();
        let shape: [usize; 3] = sides.try_into().map_err(|_e| told())?;
        let count = shape.iter().try_fold(1_usize, |count, side| count.checked_mul(*side));
        if dims.len() != 3 || count != Some(values.len()) || values.is_empty() || values.len() > MAX_VALUES {
            return Err(told());
        }
        Ok(Self { shape, values })
    }

    /// Rows of pixels of `C` values.
    ///
    /// # Errors
    /// In words: pixels of other values.
    pub(super) fn pixels<const C: usize>(&self) -> std::result::Result<&[[f32; C]], String> {
        if self.shape[2] != C {
            return Err(format!("shape {:?}", self.shape));
        }
        Ok(self.values.as_chunks().0)
    }
}

/// The pose of sixteen numbers, row by row.
///
/// # Errors
/// Other numbers: `field` of `file`.
pub(super) fn pose_of(file: &std::path::Path, field: impl Fn() -> String, numbers: &[f64]) -> Result<Pose> {
    let found = match numbers.as_chunks::<4>() {
        (rows, []) if rows.len() == 4 => match Pose::from_rows(&[rows[0], rows[1], rows[2], rows[3]]) {
            Ok(pose) => return Ok(pose),
            Err(found) => found,
        },
        _ => format!("{} numbers", numbers.len()),
    };
    Err(FormatError::invalid(file, field(), "a rigid 4x4 pose", found))
}

/// Longest image file inside another file, bytes.
pub(super) const MAX_IMAGE_BYTES: u64 = MAX_DATA_BYTES / 16;
