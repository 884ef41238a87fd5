//! A clip as validated values: what `clip.json` says, without the sensor data that its files hold.

use std::path::PathBuf;

use crate::{camera::Camera, pose::Pose};

/// The value of `format` in `clip.json`.
pub const CLIP_FORMAT: &str = "lgs-clip/1";

/// A clip: a few timestamps of `LiDAR` and cameras with poses.
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    /// Name of the clip.
    pub name: String,
    /// Where the data come from.
    pub source: String,
    /// Terms under which the data may be used.
    pub licence: String,
    /// Timestamps in file order; at least one.
    pub frames: Vec<Frame>,
}

/// One timestamp of a clip.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The sweep of this timestamp.
    pub lidar: LidarRecord,
    /// Images of this timestamp; names are unique within a frame.
    pub cameras: Vec<CameraRecord>,
    /// Tracked objects; `None` when the clip says nothing about them.
    pub boxes: Option<Vec<TrackedBox>>,
}

/// Where a sweep is and from where it was taken.
#[derive(Clone, Debug, PartialEq)]
pub struct LidarRecord {
    /// File of little-endian f32 `x, y, z, intensity`, relative to the clip directory.
    pub file: PathBuf,
    /// Seconds, in the clip's own time scale.
    pub timestamp: f64,
    /// Pose of the sensor at `timestamp` in the clip's world frame.
    pub world_from_lidar: Pose,
    /// What is known of its single returns.
    pub returns: ReturnsRecord,
}

impl LidarRecord {
    /// The record of a sweep of whose single returns nothing is known.
    pub fn new(file: PathBuf, timestamp: f64, world_from_lidar: Pose) -> Self {
        Self { file, timestamp, world_from_lidar, returns: ReturnsRecord::default() }
    }
}

/// What is known of the single returns of a sweep; the default is nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReturnsRecord {
    /// File of a little-endian f32 for each return, relative to the clip directory: when it was measured, seconds since the sweep's timestamp.
    pub times: Option<PathBuf>,
    /// Where the `LiDAR` is in whose axes the coordinates are.
    pub compensation: Compensation,
    /// Which of several sensors measured each.
    pub sensors: Option<SensorsRecord>,
}

/// Where the `LiDAR` is in whose axes the coordinates of a sweep are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Compensation {
    /// Where it was at one moment, seconds since the sweep's timestamp: compensated for its motion within the sweep.
    To(f64),
    /// Where it was at each return's own moment.
    None,
}

impl Default for Compensation {
    /// To the sweep's timestamp.
    fn default() -> Self {
        Self::To(0.0)
    }
}

/// The sensors that a sweep is of.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorsRecord {
    /// File of a byte for each return, relative to the clip directory: the index of its sensor.
    pub file: PathBuf,
    /// `[1..=256]` pose of each sensor in the `LiDAR`'s frame, in which all coordinates are.
    pub lidar_from_sensor: Vec<Pose>,
}

/// Where an image is and from where it was taken.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraRecord {
    /// Image file (PNG or JPEG), relative to the clip directory.
    pub file: PathBuf,
    /// Label image of the same size, relative to the clip directory: see [`crate::image::PixelLabel`].
    pub mask: Option<PathBuf>,
    /// Depth map of the same size.
    pub depth: Option<DepthRecord>,
    /// The camera.
    pub camera: Camera,
}

/// Where a depth map is and what its values say.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DepthRecord {
    /// File of a value for each pixel of the image file, relative to the clip directory: a 16-bit grey PNG, or a numpy array
    /// (`.npy`) of floating-point numbers `[height, width]`.
    pub file: PathBuf,
    /// What the values say.
    pub kind: DepthKind,
}

/// What the values of a depth map say.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DepthKind {
    /// Depth along the camera's z axis: millimetres in a PNG (0: unknown, 65535: that or farther), metres in an array (0 or NaN:
    /// unknown, infinity: sky).
    Metric,
    /// Inverse depth up to a scale above 0 and a shift, as monocular networks tell it: larger is nearer (NaN: unknown).
    Relative,
}

impl DepthKind {
    /// The word of `clip.json`.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Metric => "metric",
            Self::Relative => "relative",
        }
    }
}

/// An oriented box around a tracked object. Axes: x forward, y left, z up; origin at the centre.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackedBox {
    /// Identity of the object over the frames.
    pub track: String,
    /// Class of the object, free text.
    pub category: String,
    /// Length, width, height, metres.
    pub size: [f64; 3],
    /// Pose of the box in the clip's world frame.
    pub world_from_box: Pose,
}
