//! The frame and the time zero that a reconstruction works in.

use glam::{DMat3, DQuat, DVec3};
use lgs_formats::casts::to_f32;
use lgs_formats::{
    camera::Camera,
    clip::{CameraRecord, Clip, Frame},
    pose::Pose,
};

use super::PinholeView;

/// Cosine of the angle between the sensor's z axis and what is up for the cameras beyond which the sensor is mounted otherwise: 8 degrees.
/// Cameras of real rigs are pitched by up to 5.
const UPRIGHT: f64 = 0.990_268;

/// A clip in which the vehicle comes so far drives, metres.
const DRIVES: f64 = 1.0;

/// Where the clip frame lies in the clip's world, and when its time starts (specification, section 2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClipFrame {
    /// The clip frame is the first input `LiDAR`'s own frame, turned upright where that sensor is mounted otherwise: z is up.
    pub clip_from_world: Pose,
    /// That sweep's timestamp, in the clip's own time scale, seconds.
    pub time_zero: f64,
}

impl ClipFrame {
    /// The frame of a clip whose first input frame is `first_input`; that of frame 0 when there is no such frame.
    pub fn of(clip: &Clip, first_input: usize) -> Self {
        let lidar = clip.frames.get(first_input).or_else(|| clip.frames.first()).map(|frame| &frame.lidar);
        lidar.map_or(Self { clip_from_world: Pose::IDENTITY, time_zero: 0.0 }, |lidar| {
            let lidar_from_world = lidar.world_from_lidar.inverse();
            let upright = Pose::new(upright(clip, first_input, lidar_from_world.rotation()), DVec3::ZERO);
            Self { clip_from_world: upright * lidar_from_world, time_zero: lidar.timestamp }
        })
    }

    /// The axes of the clip frame in the own frame of the `LiDAR` that it was made of, where these differ: what files are written in.
    pub fn lidar_from_clip(&self, clip: &Clip, first_input: usize) -> Option<DMat3> {
        let lidar = &clip.frames.get(first_input)?.lidar;
        let turn = (self.clip_from_world * lidar.world_from_lidar).rotation().transpose();
        (upright(clip, first_input, lidar.world_from_lidar.inverse().rotation()) != DMat3::IDENTITY).then_some(turn)
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

    /// The pinhole view of a rectified camera, all of whose pixels are exposed at once: the poses meet in f64, then everything becomes f32.
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
            shutter: None,
            pixel_side: 1.0,
        }
    }
}

/// The rotation that brings up to z and the way ahead to x, in the axes of a sensor; none where its own z is up already, or nobody tells. Up is what the cameras
/// of the frame (of the clip, where it has none) take for it, or the world's z where that is nearly the same.
fn upright(clip: &Clip, frame: usize, sensor_from_world: DMat3) -> DMat3 {
    let up_of = |record: &CameraRecord| -record.camera.world_from_camera.rotation().y_axis;
    let own: Vec<DVec3> = clip.frames.get(frame).into_iter().flat_map(|frame| &frame.cameras).map(up_of).collect();
    let all = || clip.frames.iter().flat_map(|frame| &frame.cameras).map(up_of).sum();
    let up: DVec3 = if own.is_empty() { all() } else { own.into_iter().sum() };
    let Some(seen) = up.try_normalize() else { return DMat3::IDENTITY };
    let own = sensor_from_world.transpose() * DVec3::Z;
    if own.dot(seen) >= UPRIGHT {
        return DMat3::IDENTITY;
    }
    // Nearly all worlds are level, and more exactly so than cameras.
    let up = if seen.z >= UPRIGHT { DVec3::Z } else { seen };
    let level = DMat3::from_quat(DQuat::from_rotation_arc((sensor_from_world * up).normalize(), DVec3::Z));
    let ahead = level * sensor_from_world * ahead(clip, frame);
    DMat3::from_rotation_z(-ahead.y.atan2(ahead.x)) * level
}

/// Where the vehicle drives to, in the world, or where its first camera looks to while it stands; not of length one.
fn ahead(clip: &Clip, frame: usize) -> DVec3 {
    let place = |frame: &Frame| frame.lidar.world_from_lidar.translation();
    let driven = clip.frames.last().zip(clip.frames.first()).map(|(last, first)| place(last) - place(first));
    let looks =
        || clip.frames.get(frame)?.cameras.first().map(|record| record.camera.world_from_camera.rotation().z_axis);
    driven.filter(|way| way.length() >= DRIVES).or_else(looks).unwrap_or(DVec3::X)
}
