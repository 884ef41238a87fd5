//! How a camera moves while its shutter rolls.

use glam::DVec3;

use crate::{
    camera::Camera,
    clip::{Clip, LidarRecord},
    lidar_motion::Rates,
    pose::Pose,
};

/// Poses nearer in time than this tell no motion, seconds: their difference is rounding and noise.
const SAME_MOMENT: f64 = 1e-3;

/// An even motion of a camera around its timestamp.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraMotion {
    /// Rotation vector a second, radians, in the camera's axes.
    pub turn: DVec3,
    /// Metres a second, in the world's axes.
    pub velocity: DVec3,
}

impl CameraMotion {
    /// The motion of a camera (by its place in the frame's list), by its poses in the images before and after; of a camera with one image, by those of
    /// the `LiDAR` that it is mounted beside. What is alone in every way stands.
    ///
    /// # Formula
    /// With rates `a`, `b` over the times `s`, `t` before and after: `(a t + b s) / (s + t)`, the slope of the parabola through the three.
    ///
    /// # Panics
    /// When the clip has no such frame or camera.
    pub fn of(clip: &Clip, frame: usize, camera: usize) -> Self {
        let own = &clip.frames[frame].cameras[camera].camera;
        let records = clip.frames.iter().flat_map(|frame| &frame.cameras).map(|record| &record.camera);
        let poses = records
            .filter(|other| other.name == own.name)
            .map(|other: &Camera| (other.timestamp, other.world_from_camera));
        let motion = Self::through(own.timestamp, &own.world_from_camera, poses);
        motion.or_else(|| Self::beside_lidar(clip, frame, own)).unwrap_or_default()
    }

    /// The motion at a pose, through those of other times; `None` where there are none.
    fn through(time: f64, pose: &Pose, others: impl Iterator<Item = (f64, Pose)>) -> Option<Self> {
        let (mut before, mut after) = (None::<(f64, Pose)>, None::<(f64, Pose)>);
        for other in others {
            if (other.0 - time).abs() < SAME_MOMENT {
                continue;
            }
            if other.0 < time && before.is_none_or(|found| found.0 < other.0) {
                before = Some(other);
            } else if other.0 > time && after.is_none_or(|found| found.0 > other.0) {
                after = Some(other);
            }
        }
        let rates = |(at, other): (f64, Pose)| (Rates::between(pose, &other, at - time), (at - time).abs());
        let motion = |Rates { turn, velocity }| Self { turn, velocity };
        match (before.map(rates), after.map(rates)) {
            (Some((a, s)), Some((b, t))) => Some(Self {
                turn: (a.turn * t + b.turn * s) / (s + t),
                velocity: (a.velocity * t + b.velocity * s) / (s + t),
            }),
            (one, other) => one.or(other).map(|(rates, _)| motion(rates)),
        }
    }

    /// The motion of a camera that is carried along with the `LiDAR`.
    fn beside_lidar(clip: &Clip, frame: usize, camera: &Camera) -> Option<Self> {
        let lidar = &clip.frames[frame].lidar;
        let poses =
            clip.frames.iter().map(|frame| &frame.lidar).map(|at: &LidarRecord| (at.timestamp, at.world_from_lidar));
        let Self { turn, velocity } = Self::through(lidar.timestamp, &lidar.world_from_lidar, poses)?;
        let turn = lidar.world_from_lidar.rotation() * turn;
        let arm = camera.world_from_camera.translation() - lidar.world_from_lidar.translation();
        Some(Self {
            turn: camera.world_from_camera.rotation().transpose() * turn,
            velocity: velocity + turn.cross(arm),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use glam::DMat3;

    use super::*;
    use crate::{
        camera::Intrinsics,
        clip::{CameraRecord, Frame},
    };

    /// A vehicle on a circle of 20 m at 10 m/s, its camera 2 m ahead of the LiDAR and looking ahead.
    fn world_from_lidar(time: f64) -> Pose {
        let angle = 0.5 * time;
        Pose::new(DMat3::from_rotation_z(angle), 20.0 * DVec3::new(angle.sin(), 1.0 - angle.cos(), 0.0))
    }

    fn clip(cameras: &[usize]) -> Clip {
        let lidar_from_camera = Pose::new(DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X), DVec3::new(2.0, 0.0, 0.0));
        let frame = |k: usize| {
            let time = 0.1 * k as f64;
            let camera = Camera {
                name: "c".to_owned(),
                timestamp: time + 0.02,
                width: 8,
                height: 6,
                intrinsics: Intrinsics { fx: 5.0, fy: 5.0, cx: 4.0, cy: 3.0 },
                distortion: None,
                readout: None,
                world_from_camera: world_from_lidar(time + 0.02) * lidar_from_camera,
            };
            let record = CameraRecord { file: PathBuf::from("a.png"), mask: None, depth: None, camera };
            Frame {
                lidar: LidarRecord::new(PathBuf::from("a.bin"), time, world_from_lidar(time)),
                cameras: if cameras.contains(&k) { vec![record] } else { Vec::new() },
                boxes: None,
            }
        };
        let name = || "n".to_owned();
        Clip { name: name(), source: name(), licence: name(), frames: (0..3).map(frame).collect() }
    }

    #[test]
    fn a_camera_turns_and_moves_as_its_poses_say() {
        let own = world_from_lidar(0.12).rotation();
        // Ahead at 10 m/s, sideways at the rate of turn times the arm.
        let want = own * DVec3::new(10.0, 1.0, 0.0);
        for cameras in [&[0, 1, 2][..], &[1]] {
            let clip = clip(cameras);
            let CameraMotion { turn, velocity } = CameraMotion::of(&clip, 1, 0);
            assert!(turn.distance(DVec3::new(0.0, -0.5, 0.0)) < 2e-3, "{turn}");
            assert!(velocity.distance(want) < 0.12, "{velocity} {want}");
        }
        assert!(CameraMotion::of(&clip(&[0, 1, 2]), 1, 0).velocity.distance(want) < 0.02);
    }

    #[test]
    fn what_is_alone_stands() {
        let mut alone = clip(&[0]);
        alone.frames.truncate(1);
        assert_eq!(CameraMotion::of(&alone, 0, 0), CameraMotion::default());
        // Two poses of the same moment, nearly, tell nothing.
        let mut twice = clip(&[0, 1]);
        twice.frames.truncate(2);
        twice.frames[1].lidar.timestamp = 1e-300;
        twice.frames[1].cameras[0].camera.timestamp = 0.02 + 1e-12;
        assert_eq!(CameraMotion::of(&twice, 0, 0), CameraMotion::default());
    }
}
