//! Pinhole cameras, lens distortion and shutters.

use glam::DMat3;

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

/// What the lens of a camera makes of straight lines in its image file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distortion {
    /// Brown and Conrady's `[k1, k2, p1, p2, k3]` (`OpenCV`'s order).
    BrownConrady([f64; 5]),
    /// A fisheye lens.
    Fisheye(Fisheye),
}

/// A fisheye lens by `OpenCV`'s model of four coefficients, of whose image a camera is a part.
///
/// # Formula
/// A ray at angle `t` from the axis falls at radius `f t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8)` from the principal point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fisheye {
    /// `[k1, k2, k3, k4]`.
    pub coefficients: [f64; 4],
    /// Width of the image file, pixels.
    pub width: u32,
    /// Height of the image file, pixels.
    pub height: u32,
    /// Intrinsics of the image file.
    pub intrinsics: Intrinsics,
    /// Pose of the fisheye camera in the clip's world frame.
    pub world_from_fisheye: Pose,
    /// How the pinhole that is cut out of its image is turned.
    pub fisheye_from_pinhole: DMat3,
}

/// How long a rolling shutter takes from the first line of an image to the last, and which way it goes.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Readout {
    /// Seconds from the first line to the last; 0: all at once.
    pub seconds: f64,
    /// Where in the image file the first line is.
    pub direction: ReadoutDirection,
    /// Seconds after the camera's timestamp, at which its pose is given, at which the middle of the file is exposed.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub middle: f64,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks with a reference")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// The way that a rolling shutter goes over the image file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ReadoutDirection {
    /// By rows, the top one first.
    TopToBottom,
    /// By rows, the bottom one first.
    BottomToTop,
    /// By columns, the left one first.
    LeftToRight,
    /// By columns, the right one first.
    RightToLeft,
}

impl Readout {
    /// Whether anything is exposed at another moment than the camera's timestamp.
    pub fn is_rolling(&self) -> bool {
        self.seconds > 0.0 || self.middle != 0.0
    }

    /// Seconds after the camera's timestamp at which a place of the file is exposed.
    ///
    /// # Shapes
    /// `u` and `v` as shares of the file's width and height.
    pub fn moment(&self, [u, v]: [f64; 2]) -> f64 {
        let share = match self.direction {
            ReadoutDirection::TopToBottom => v,
            ReadoutDirection::BottomToTop => 1.0 - v,
            ReadoutDirection::LeftToRight => u,
            ReadoutDirection::RightToLeft => 1.0 - u,
        };
        self.middle + self.seconds * (share.clamp(0.0, 1.0) - 0.5)
    }
}

/// One camera at one moment. Axes: x right, y down, z forward.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Name of the sensor, shared by its images of all frames.
    pub name: String,
    /// Moment of exposure, of a rolling shutter as `readout` says, seconds, in the clip's own time scale.
    pub timestamp: f64,
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Pinhole intrinsics at `width` x `height`.
    pub intrinsics: Intrinsics,
    /// Lens distortion of the image file; `None` when it is rectified.
    pub distortion: Option<Distortion>,
    /// The shutter, where it is a rolling one.
    pub readout: Option<Readout>,
    /// Pose of the camera at `timestamp` in the clip's world frame.
    pub world_from_camera: Pose,
}

impl Camera {
    /// Width and height of the image file, pixels.
    pub const fn file_size(&self) -> [u32; 2] {
        match self.distortion {
            Some(Distortion::Fisheye(Fisheye { width, height, .. })) => [width, height],
            _ => [self.width, self.height],
        }
    }
}
