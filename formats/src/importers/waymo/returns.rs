//! Range images to returns.
//!
//! # Source
//! waymo-research/waymo-open-dataset, `dataset.proto` and `utils/range_image_utils.py`.

use std::f64::consts::PI;

use glam::{DMat3, DVec3};

use super::snapshot::{Inclinations, LaserMount, RangeImage};
use crate::pose::Pose;

/// Seconds of a turn of a `LiDAR`.
pub(super) const TURN: f64 = 0.1;

/// The returns of a sweep, sensor by sensor.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Returns {
    /// `x, y, z, intensity` in the sweep's frame.
    pub(super) rows: Vec<[f32; 4]>,
    /// `[N]` seconds since the first shot of the frame.
    pub(super) times: Vec<f64>,
    /// `[N]` index of the sensor.
    pub(super) sensors: Vec<u8>,
}

/// Frames that the returns of a sweep go through.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frames {
    pub(super) world_from_vehicle: Pose,
    /// Of the frame in which returns are stored.
    pub(super) lidar_from_vehicle: Pose,
}

impl Returns {
    /// Nothing: adds the returns of a range image, those of sensor `index`.
    ///
    /// # Formula
    /// Column i looks to azimuth `((W - i - 1/2) / W 2 - 1) pi - atan2(e10, e00)` with the rotation e of the mount, row r to the
    /// inclination of beam H - 1 - r. Where the vehicle's pose of a pixel is known, its point goes by it to the world and back by the frame's; six
    /// zeros are none. A range above 0 is a return.
    ///
    /// # Errors
    /// In words: images of other shapes than the mount's beams ask for.
    pub(super) fn add(
        &mut self,
        index: u8,
        mount: &LaserMount,
        frames: &Frames,
        image: &RangeImage,
        poses: Option<&RangeImage>,
    ) -> Result<(), String> {
        let [height, width, _] = image.shape;
        let pixels = image.pixels::<4>()?;
        let poses = match poses {
            Some(poses) if poses.shape[..2] != image.shape[..2] => {
                return Err(format!("poses of shape {:?} for ranges of shape {:?}", poses.shape, image.shape));
            }
            Some(poses) => Some(poses.pixels::<6>()?),
            None => None,
        };
        let beams = beams(&mount.inclinations, height)?;
        let rotation = mount.vehicle_from_laser.rotation();
        let correction = rotation.col(0).y.atan2(rotation.col(0).x);
        let columns: Vec<([f64; 2], f64)> = (0..width)
            .map(|column| {
                let share = (count(width - column) - 0.5) / count(width);
                let (sin, cos) = ((share * 2.0 - 1.0) * PI - correction).sin_cos();
                ([sin, cos], (1.0 - share) * TURN)
            })
            .collect();
        let vehicle_from_world = frames.world_from_vehicle.inverse();
        for (row, line) in pixels.chunks_exact(width.max(1)).enumerate() {
            let (up, level) = beams[row].sin_cos();
            for (column, &[range, intensity, _, _]) in line.iter().enumerate() {
                if !(range > 0.0) {
                    continue;
                }
                let ([sin, cos], time) = columns[column];
                let ray = DVec3::new(cos * level, sin * level, up);
                let mut point = mount.vehicle_from_laser.transform_point(ray * f64::from(range));
                if let Some(pose) = poses.and_then(|poses| vehicle_pose(poses[row * width + column])) {
                    point = vehicle_from_world.transform_point(pose.transform_point(point));
                }
                let [x, y, z] = single(frames.lidar_from_vehicle.transform_point(point));
                self.rows.push([x, y, z, intensity]);
                self.times.push(time);
                self.sensors.push(index);
            }
        }
        Ok(())
    }
}

/// `[height]` inclination of each row, the top one first.
fn beams(inclinations: &Inclinations, height: usize) -> Result<Vec<f64>, String> {
    match inclinations {
        Inclinations::Each(beams) if beams.len() == height => Ok(beams.iter().rev().copied().collect()),
        Inclinations::Each(beams) => Err(format!("{height} rows for {} beams", beams.len())),
        Inclinations::Between([low, high]) => {
            let beam = |row: usize| low + (count(row) + 0.5) / count(height) * (high - low);
            Ok((0..height).rev().map(beam).collect())
        }
    }
}

/// The pose of the vehicle of a pixel: turned by yaw, pitch and roll in turn.
fn vehicle_pose(pose: [f32; 6]) -> Option<Pose> {
    if pose == [0.0; 6] {
        return None;
    }
    let [roll, pitch, yaw, x, y, z] = pose.map(f64::from);
    let rotation = DMat3::from_rotation_z(yaw) * DMat3::from_rotation_y(pitch) * DMat3::from_rotation_x(roll);
    Some(Pose::new(rotation, DVec3::new(x, y, z)))
}

#[expect(clippy::cast_precision_loss, reason = "rows and columns, far below 2^53")]
const fn count(value: usize) -> f64 {
    value as f64
}

#[expect(clippy::cast_possible_truncation, reason = "metres around a sensor, kept as f32 by the format")]
fn single(point: DVec3) -> [f32; 3] {
    point.to_array().map(|value| value as f32)
}
