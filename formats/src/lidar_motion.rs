//! Where a `LiDAR` was while it swept, and what that makes of its returns.

use std::path::Path;

use glam::{DMat3, DQuat, DVec3};

use crate::{
    clip::{Clip, Compensation, LidarRecord},
    error::{FormatError, Result},
    pose::Pose,
    sweep::{MAX_COORDINATE, Sweep, check_return},
};

/// The way of the `LiDAR` around a sweep: evenly from its pose to those of the sweeps before and after, which are nearest in time; beyond
/// the first and the last sweep of a clip it goes on as beside it. A lone sweep stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LidarMotion {
    world_from_lidar: Pose,
    before: Rates,
    after: Rates,
}

/// An even motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Rates {
    /// Rotation vector a second, radians, in the axes of the pose that it starts from.
    pub(crate) turn: DVec3,
    /// Metres a second, in the world's axes.
    pub(crate) velocity: DVec3,
}

impl Rates {
    /// From one pose to another, `seconds` later.
    pub(crate) fn between(a: &Pose, b: &Pose, seconds: f64) -> Self {
        let turn = DQuat::from_mat3(&(a.rotation().transpose() * b.rotation()));
        let turn = if turn.w < 0.0 { -turn } else { turn };
        Self { turn: turn.to_scaled_axis() / seconds, velocity: (b.translation() - a.translation()) / seconds }
    }
}

impl LidarMotion {
    /// The motion around the sweep of a frame, by the poses of the clip's frames.
    ///
    /// # Panics
    /// When the clip has no such frame.
    pub fn of(clip: &Clip, frame: usize) -> Self {
        let own = &clip.frames[frame].lidar;
        let others = || clip.frames.iter().map(|frame| &frame.lidar);
        let later = |record: &&LidarRecord| record.timestamp > own.timestamp;
        let earlier = |record: &&LidarRecord| record.timestamp < own.timestamp;
        let next = others().filter(later).min_by(|a, b| a.timestamp.total_cmp(&b.timestamp));
        let previous = others().filter(earlier).max_by(|a, b| a.timestamp.total_cmp(&b.timestamp));
        let to = |other: &LidarRecord| {
            Rates::between(&own.world_from_lidar, &other.world_from_lidar, other.timestamp - own.timestamp)
        };
        let [before, after] = [previous, next].map(|other| other.map(to));
        Self {
            world_from_lidar: own.world_from_lidar,
            before: before.or(after).unwrap_or_default(),
            after: after.or(before).unwrap_or_default(),
        }
    }

    /// The pose of the `LiDAR`, `seconds` after the sweep's timestamp, in its own frame at that timestamp.
    ///
    /// # Formula
    /// With the rates w, v of the side: rotation `exp(w s)`, translation `R^T v s`.
    pub fn lidar_from_lidar_at(&self, seconds: f64) -> Pose {
        let Rates { turn, velocity } = if seconds < 0.0 { self.before } else { self.after };
        let rotation = DMat3::from_quat(DQuat::from_scaled_axis(turn * seconds));
        Pose::new(rotation, self.world_from_lidar.rotation().transpose() * velocity * seconds)
    }
}

/// A sweep as its file has it, with all returns in the frame of the `LiDAR` at the sweep's timestamp, and with the origins of their rays.
///
/// # Errors
/// A return that the motion takes out of the range of sensors, by its index; `path` is what the error names.
pub(crate) fn placed(path: &Path, mut sweep: Sweep, record: &LidarRecord, motion: &LidarMotion) -> Result<Sweep> {
    let returns = &record.returns;
    let at = |index: usize| sweep.times.as_ref().map_or(0.0, |times| f64::from(times[index]));
    let whole = match returns.compensation {
        Compensation::To(0.0) => Some(None),
        Compensation::To(seconds) => Some(Some(motion.lidar_from_lidar_at(seconds))),
        Compensation::None => None,
    };
    let moves = sweep.times.is_some() || returns.sensors.is_some();
    let mut origins = Vec::with_capacity(if moves { sweep.points.len() } else { 0 });
    for index in 0..sweep.points.len() {
        let own = moves.then(|| motion.lidar_from_lidar_at(at(index)));
        if let Some(pose) = whole.unwrap_or(own) {
            let point = single(pose.transform_point(DVec3::from(sweep.points[index].map(f64::from))));
            check_return(path, index, point, sweep.intensities[index])?;
            sweep.points[index] = point;
        }
        if let Some(own) = own {
            let sensors = returns.sensors.as_ref().zip(sweep.sensors.as_ref());
            let sensor = sensors.map_or(DVec3::ZERO, |(record, indices)| {
                record.lidar_from_sensor[usize::from(indices[index])].translation()
            });
            let origin = single(own.transform_point(sensor));
            if !origin.iter().all(|v| v.abs() <= MAX_COORDINATE) {
                let expected =
                    format!("a ray that starts within {MAX_COORDINATE} m of the LiDAR by the poses of the frames");
                return Err(FormatError::invalid(path, format!("point {index}"), expected, format!("{origin:?}")));
            }
            origins.push(origin);
        }
    }
    sweep.origins = moves.then_some(origins);
    Ok(sweep)
}

#[expect(clippy::cast_possible_truncation, reason = "metres around a sensor, kept as f32 by the format")]
fn single(point: DVec3) -> [f32; 3] {
    point.to_array().map(|value| value as f32)
}
