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
    /// Adds the returns of the range image of sensor `index`.
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
                if range.is_nan() || range <= 0.0 {
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

#[cfg(test)]
mod tests {
    use super::super::snapshot::Sensor;
    use super::*;

    fn mount(yaw: f64, inclinations: Inclinations) -> LaserMount {
        let vehicle_from_laser = Pose::new(DMat3::from_rotation_z(yaw), DVec3::new(0.0, 0.0, 2.0));
        LaserMount { sensor: Sensor::laser(1).unwrap(), vehicle_from_laser, inclinations }
    }

    /// The returns of an image of two rows and four columns whose ranges are these, in the vehicle's frame, which is the world.
    fn of(mount: &LaserMount, ranges: [f32; 8], poses: Option<&RangeImage>) -> Result<Returns, String> {
        let values = ranges.iter().flat_map(|&range| [range, 0.5, 0.0, -1.0]).collect();
        let image = RangeImage::new(&[2, 4, 4], values).unwrap();
        let frames = Frames { world_from_vehicle: Pose::IDENTITY, lidar_from_vehicle: Pose::IDENTITY };
        let mut returns = Returns::default();
        returns.add(3, mount, &frames, &image, poses).map(|()| returns)
    }

    fn is_at(row: [f32; 4], want: [f64; 3]) -> bool {
        DVec3::from([row[0], row[1], row[2]].map(f64::from)).distance(DVec3::from(want)) < 1e-5
    }

    #[test]
    fn columns_go_clockwise_from_behind_whatever_the_mount() {
        let half = 2.0_f64.sqrt() * 2.5;
        // Behind on the left, ahead on the left, ahead on the right, behind on the right.
        let want = [[-half, half, 2.0], [half, half, 2.0], [half, -half, 2.0], [-half, -half, 2.0]];
        for yaw in [0.0, 2.6, -1.0] {
            let mount = mount(yaw, Inclinations::Each(vec![-0.1, 0.0]));
            let returns = of(&mount, [5.0, 5.0, 5.0, 5.0, -1.0, 0.0, f32::NAN, -1.0], None).unwrap();
            assert!(
                returns.rows.len() == 4 && returns.rows.iter().zip(want).all(|(row, want)| is_at(*row, want)),
                "{returns:?}"
            );
            assert_eq!(returns.sensors, [3; 4]);
            let wrong = returns.times.iter().zip([0.0125, 0.0375, 0.0625, 0.0875]).any(|(a, b)| (a - b).abs() > 1e-12);
            assert!(!wrong, "{:?}", returns.times);
        }
    }

    #[test]
    fn the_first_row_is_the_highest_beam() {
        let each = mount(0.0, Inclinations::Each(vec![-0.2, 0.1]));
        // Of two rows between -0.4 and 0.4 the middles are -0.2 and 0.2.
        let between = mount(0.0, Inclinations::Between([-0.4, 0.4]));
        for (mount, top) in [(each, 0.1_f64), (between, 0.2)] {
            let returns = of(&mount, [1.0, -1.0, -1.0, -1.0, 1.0, -1.0, -1.0, -1.0], None).unwrap();
            let heights: Vec<f64> = returns.rows.iter().map(|row| f64::from(row[2]) - 2.0).collect();
            assert!((heights[0] - top.sin()).abs() < 1e-6 && (heights[1] + 0.2_f64.sin()).abs() < 1e-6, "{heights:?}");
        }
    }

    #[test]
    fn a_pixel_goes_by_its_own_pose_where_it_has_one() {
        let mount = mount(0.0, Inclinations::Each(vec![-0.1, 0.0]));
        let mut values = vec![0.0; 2 * 4 * 6];
        // A quarter turn to the left, then 10 m along x; the second pixel has no pose.
        values[..6].copy_from_slice(&[0.0, 0.0, std::f32::consts::FRAC_PI_2, 10.0, 0.0, 0.0]);
        let poses = RangeImage::new(&[2, 4, 6], values).unwrap();
        let ranges = [5.0, 5.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0];
        let half = 2.0_f64.sqrt() * 2.5;
        let returns = of(&mount, ranges, Some(&poses)).unwrap();
        assert!(
            is_at(returns.rows[0], [10.0 - half, -half, 2.0]) && is_at(returns.rows[1], [half, half, 2.0]),
            "{returns:?}"
        );
    }

    #[test]
    fn images_of_other_shapes_are_refused() {
        let mount = mount(0.0, Inclinations::Each(vec![-0.1, 0.0, 0.1]));
        assert_eq!(of(&mount, [1.0; 8], None).unwrap_err(), "2 rows for 3 beams");
        let mount = super::tests::mount(0.0, Inclinations::Between([-0.1, 0.1]));
        let poses = RangeImage::new(&[4, 2, 6], vec![0.0; 48]).unwrap();
        assert!(of(&mount, [1.0; 8], Some(&poses)).unwrap_err().starts_with("poses of shape [4, 2, 6]"));
        assert!(RangeImage::new(&[2, 4, 4], vec![0.0; 31]).is_err() && RangeImage::new(&[-1, 4], Vec::new()).is_err());
        assert!(RangeImage::new(&[1 << 40, 0, 4], Vec::new()).is_err());
    }
}
