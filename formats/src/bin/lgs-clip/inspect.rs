//! What is in a clip and what looks wrong about it.

mod calibration;
mod columns;
mod edges;
mod masks;
mod measure;
mod project;
mod sheet;
mod text;
mod units;
mod warn;

use std::collections::BTreeMap;

use lgs_formats::camera::Readout;
use serde::Serialize;

pub(crate) use measure::measure;
pub(crate) use sheet::contact_sheet;

/// The value of `format` in the JSON of an inspection.
const INSPECT_FORMAT: &str = "lgs-inspect/1";

/// What is in a clip.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Report {
    format: &'static str,
    clip: String,
    source: String,
    licence: String,
    num_frames: usize,
    /// Seconds from the first sweep to the last.
    duration_s: f64,
    lidar: Lidar,
    cameras: Vec<CameraReport>,
    /// Share of all returns that no camera of their frame sees.
    unseen_share: f64,
    /// `None`: the clip says nothing about boxes.
    boxes: Option<Boxes>,
    pub(crate) warnings: Vec<String>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct Lidar {
    /// Sweeps a second; `None` for a single one.
    rate_hz: Option<f64>,
    num_points: Spread,
    /// Corners of the box around all returns, metres, in the first sweep's frame.
    extent_min: [f64; 3],
    extent_max: [f64; 3],
    /// Length of the sensor's path, metres.
    path_m: f64,
    /// `None`: the clip says nothing about single returns.
    #[serde(skip_serializing_if = "Option::is_none")]
    returns: Option<Returns>,
}

/// What is known of single returns.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Returns {
    /// Sweeps whose returns have times.
    num_timed: usize,
    /// First and last return of a sweep, milliseconds after its timestamp; of the sweeps that have times.
    first_ms: Spread,
    last_ms: Spread,
    /// Whether the coordinates of all sweeps are compensated for the motion within the sweep.
    motion_compensated: bool,
    /// Most sensors of a sweep.
    num_sensors: usize,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct CameraReport {
    name: String,
    num_images: usize,
    /// Of the first image.
    width: u32,
    height: u32,
    /// Height and width of all images, where they differ.
    #[serde(skip_serializing_if = "Option::is_none")]
    sizes: Option<Vec<[u32; 2]>>,
    rate_hz: Option<f64>,
    /// Image minus sweep, milliseconds.
    offset_ms: Spread,
    /// Share of their frame's returns that the images see.
    visible_share: Spread,
    distorted: bool,
    fisheye: bool,
    masked: bool,
    readout: Option<Readout>,
    /// What the first of its depth maps says, where it has some.
    depth_maps: Option<&'static str>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct Boxes {
    num_tracks: usize,
    /// Tracks by category.
    categories: BTreeMap<String, usize>,
}

/// Smallest, mean and largest of some values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Spread {
    min: f64,
    mean: f64,
    max: f64,
}

impl Spread {
    /// Of at least one value; zeros of none.
    #[expect(clippy::cast_precision_loss, reason = "a number of frames")]
    fn of(values: &[f64]) -> Self {
        let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
        let fold = |start: f64, pick: fn(f64, f64) -> f64| values.iter().copied().fold(start, pick);
        if values.is_empty() {
            return Self { min: 0.0, mean: 0.0, max: 0.0 };
        }
        Self { min: fold(f64::INFINITY, f64::min), mean, max: fold(f64::NEG_INFINITY, f64::max) }
    }
}
