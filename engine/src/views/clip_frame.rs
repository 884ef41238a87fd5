//! The frame and the time zero that a reconstruction works in.

use glam::DVec3;
use lgs_formats::{camera::Camera, clip::Clip, pose::Pose};

use super::{PinholeView, to_f32};

/// Where the clip frame lies in the clip's world, and when its time starts (specification, section 2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClipFrame {
    /// The clip frame is the first input `LiDAR`'s own frame.
    pub clip_from_world: Pose,
    /// That sweep's timestamp, in the clip's own time scale, seconds.
    pub time_zero: f64,
}

impl ClipFrame {
    /// The frame of a clip whose first input frame is `first_input`; that of frame 0 when there is no such frame.
    pub fn of(clip: &Clip, first_input: usize) -> Self {
        let lidar = clip.frames.get(first_input).or_else(|| clip.frames.first()).map(|frame| &frame.lidar);
        lidar.map_or(Self { clip_from_world: Pose::IDENTITY, time_zero: 0.0 }, |lidar| Self {
            clip_from_world: lidar.world_from_lidar.inverse(),
            time_zero: lidar.timestamp,
        })
    }

    /// Seconds since time zero: the difference in f64, then f32.
    pub fn time(&self, timestamp: f64) -> f32 {
        to_f32(timestamp - self.time_zero)
    }

    /// Seconds since time zero, `seconds` after a timestamp: in f64, then f32.
    pub fn later(&self, timestamp: f64, seconds: f32) -> f32 {
        to_f32(timestamp - self.time_zero + f64::from(seconds))
    }

    /// Points of a sensor's frame in the clip frame, metres: transformed in f64, then f32.
    pub fn points(&self, world_from_sensor: &Pose, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let clip_from_sensor = self.clip_from_world * *world_from_sensor;
        let moved = points.iter().map(|p| clip_from_sensor.transform_point(DVec3::from(p.map(f64::from))));
        moved.map(|p| p.to_array().map(to_f32)).collect()
    }

    /// The pinhole view of a rectified camera: the poses meet in f64, then everything becomes f32.
    pub fn pinhole(&self, camera: &Camera) -> PinholeView {
        let rows = (self.clip_from_world * camera.world_from_camera).inverse().rows();
        PinholeView {
            width: camera.width as usize,
            height: camera.height as usize,
            fx: to_f32(camera.intrinsics.fx),
            fy: to_f32(camera.intrinsics.fy),
            cx: to_f32(camera.intrinsics.cx),
            cy: to_f32(camera.intrinsics.cy),
            camera_from_clip: std::array::from_fn(|r| rows[r].map(to_f32)),
            time: self.time(camera.timestamp),
        }
    }
}
