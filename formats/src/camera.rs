//! Pinhole cameras and lens distortion.

use crate::pose::Pose;

/// Pinhole intrinsics in pixels; a pixel's centre is at +0.5, so `cx = width / 2` is the middle.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Intrinsics {
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point x, pixels.
    pub cx: f64,
    /// Principal point y, pixels.
    pub cy: f64,
}

impl Intrinsics {
    /// The intrinsics of the same camera after its image was resized by `sx`, `sy`.
    #[must_use]
    pub fn scaled(&self, sx: f64, sy: f64) -> Self {
        Self { fx: self.fx * sx, fy: self.fy * sy, cx: self.cx * sx, cy: self.cy * sy }
    }
}

/// Brown-Conrady lens distortion `[k1, k2, p1, p2, k3]` (`OpenCV`'s order).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distortion(pub [f64; 5]);

/// One camera at one moment. Axes: x right, y down, z forward.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Name of the sensor, shared by its images of all frames.
    pub name: String,
    /// Moment of exposure, seconds, in the clip's own time scale.
    pub timestamp: f64,
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Pinhole intrinsics at `width` x `height`.
    pub intrinsics: Intrinsics,
    /// Lens distortion of the image file; `None` when it is rectified.
    pub distortion: Option<Distortion>,
    /// Pose of the camera in the clip's world frame.
    pub world_from_camera: Pose,
}
