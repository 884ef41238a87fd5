//! Where returns of a sweep lie in an image.

use glam::DVec3;
use lgs_formats::{camera::Camera, pose::Pose};

/// Nearest depth at which a return counts as seen, metres.
const NEAR: f64 = 0.1;

/// A return in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Projected {
    /// Pixels from the left and the top edge.
    pub(super) u: f64,
    pub(super) v: f64,
    /// Metres along the optical axis.
    pub(super) depth: f64,
}

/// The camera from the LiDAR.
pub(super) fn camera_from_lidar(camera: &Camera, world_from_lidar: &Pose) -> Pose {
    camera.world_from_camera.inverse() * *world_from_lidar
}

/// Where the rectified image shows a return; `None` outside it.
pub(super) fn project(camera: &Camera, camera_from_lidar: &Pose, point: [f32; 3]) -> Option<Projected> {
    let p = camera_from_lidar.transform_point(DVec3::from(point.map(f64::from)));
    let k = camera.intrinsics;
    let (u, v) = (k.fx * p.x / p.z + k.cx, k.fy * p.y / p.z + k.cy);
    let inside = p.z >= NEAR && u >= 0.0 && v >= 0.0 && u < f64::from(camera.width) && v < f64::from(camera.height);
    inside.then_some(Projected { u, v, depth: p.z })
}
