//! When each return of a turning scanner was measured, and where it lies once all are brought to one moment.

use std::{f64::consts::PI, path::Path};

use glam::DVec3;

use super::{Times, motion::Motion};
use crate::{clip::LidarRecord, error::Result, sweep::Sweep};

/// Beginnings and ends of the turns of a drive.
#[derive(Debug)]
pub(super) struct Spins {
    start: Times,
    end: Times,
}

/// The turn of a sweep: from behind, over the left, the front and the right (clockwise as seen from above), to behind again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spin {
    /// Seconds from the sweep's timestamp, when the scanner faces forward, back to its beginning.
    before: f64,
    /// Seconds from the timestamp to its end.
    after: f64,
}

impl Spins {
    /// The turns of the sweeps in `folder`; `None` where the drive does not say when they begin and end.
    pub(super) fn read(folder: &Path) -> Result<Option<Self>> {
        let [start, end] = ["timestamps_start.txt", "timestamps_end.txt"].map(|name| folder.join(name));
        if !start.is_file() || !end.is_file() {
            return Ok(None);
        }
        Ok(Some(Self { start: Times::read(&start)?, end: Times::read(&end)? }))
    }

    /// The turn of the sweep of number `number`.
    pub(super) fn of(&self, number: u64, timestamp: f64) -> Result<Spin> {
        Ok(Spin { before: timestamp - self.start.of(number)?, after: self.end.of(number)? - timestamp })
    }
}

impl Spin {
    /// When the scanner measured what lies in a direction, seconds since the sweep's timestamp.
    ///
    /// # Formula
    /// With the azimuth a from forward to the left: `-before a / pi` on the left, `-after a / pi` on the right.
    fn time(&self, x: f64, y: f64) -> f64 {
        let azimuth = y.atan2(x);
        -azimuth / PI * if azimuth > 0.0 { self.before } else { self.after }
    }

    /// The sweep with times, and all returns where they are from the scanner's place at the timestamp.
    ///
    /// # Errors
    /// No pose at the time of a return, a time that is none of a sweep; `path` is what errors name.
    #[expect(clippy::cast_possible_truncation, reason = "metres around a sensor, kept as f32 by the format")]
    pub(super) fn unwound(&self, path: &Path, sweep: Sweep, record: &LidarRecord, motion: &Motion) -> Result<Sweep> {
        let directions = sweep.points.iter().map(|&[x, y, _]| [f64::from(x), f64::from(y)]);
        let times: Vec<f64> = directions.map(|[x, y]| self.time(x, y)).collect();
        let mut sweep = sweep.with_times(path, times.iter().copied())?;
        let lidar_from_world = record.world_from_lidar.inverse();
        for (point, time) in sweep.points.iter_mut().zip(times) {
            let pose = lidar_from_world * motion.world_from_lidar_at(record.timestamp + time)?;
            let moved = pose.transform_point(DVec3::from(point.map(f64::from)));
            *point = moved.to_array().map(|value| value as f32);
        }
        Ok(sweep)
    }
}

#[cfg(test)]
mod tests {
    use super::Spin;

    #[test]
    fn the_scanner_comes_from_behind_over_the_left() {
        let spin = Spin { before: 0.05, after: 0.06 };
        for ([x, y], want) in [([1.0, 0.0], 0.0), ([0.0, 1.0], -0.025), ([0.0, -1.0], 0.03), ([-1.0, 1e-12], -0.05)] {
            assert!((spin.time(x, y) - want).abs() < 1e-9, "{x} {y}: {}", spin.time(x, y));
        }
        assert!((spin.time(-1.0, -1e-12) - 0.06).abs() < 1e-9);
    }
}
