//! Which moment of a sweep its timestamp is.

use lgs_formats::clip::{Clip, ReturnsRecord};
use serde::Serialize;

use super::{PointCloud, Turn};

/// Shortest and longest sweep, seconds: 30 and 7 a second.
const SWEEP: [f64; 2] = [0.03, 0.15];

/// Which moment of a sweep its timestamp is, if not the middle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stamp {
    /// The one at which its first return was measured.
    Beginning,
    /// The one at which its last return was measured.
    End,
}

impl Stamp {
    /// What was found, for people.
    pub const fn in_words(self) -> &'static str {
        match self {
            Self::Beginning => {
                "timestamps are those of their beginnings, as outlines of what moves tell; returns measured half a sweep later"
            }
            Self::End => {
                "timestamps are those of their ends, as outlines of what moves tell; returns measured half a sweep earlier"
            }
        }
    }

    /// Seconds after the timestamp at which the returns of a sweep of so many seconds were measured, in the mean.
    pub(crate) fn delay(self, sweep_s: f64) -> f64 {
        match self {
            Self::Beginning => 0.5 * sweep_s,
            Self::End => -0.5 * sweep_s,
        }
    }
}

/// When returns were measured, where the sweeps or the images told and not the clip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Timing {
    /// How the `LiDAR` turned meanwhile.
    pub turn: Option<Turn>,
    /// Which moment of the sweeps their timestamps are, if not the middle.
    pub stamp: Option<Stamp>,
}

/// Seconds of a sweep, the least time between two of the clip; `None` where the clip, or something else, says when single returns of the cloud
/// were measured, and where sweeps are too far apart or too near to follow one another.
pub(crate) fn sweep_seconds(cloud: &PointCloud, clip: &Clip) -> Option<f64> {
    let mut times: Vec<f64> = clip.frames.iter().map(|record| record.lidar.timestamp).collect();
    times.sort_by(f64::total_cmp);
    let seconds = times.windows(2).map(|pair| pair[1] - pair[0]).filter(|&gap| gap > 0.0).reduce(f64::min)?;
    let mut start = 0;
    for run in cloud.frames.chunk_by(|a, b| a == b) {
        let times = &cloud.times[start..start + run.len()];
        let says_nothing = clip.frames.get(run[0] as usize)?.lidar.returns == ReturnsRecord::default();
        if !says_nothing || times.windows(2).any(|pair| pair[0] != pair[1]) {
            return None;
        }
        start += run.len();
    }
    (SWEEP[0]..=SWEEP[1]).contains(&seconds).then_some(seconds)
}
