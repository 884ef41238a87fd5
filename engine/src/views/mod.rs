//! Views: what one camera saw at one moment, at the size and in the frame that the reconstruction works in.

use lgs_formats::image::{PixelLabel, RgbImage};

/// A pinhole camera at one moment, in f32 and the clip frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PinholeView {
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
    /// Focal length along x, pixels.
    pub fx: f32,
    /// Focal length along y, pixels.
    pub fy: f32,
    /// Principal point x, pixels (centre of a pixel at +0.5).
    pub cx: f32,
    /// Principal point y, pixels.
    pub cy: f32,
    /// Rows of `camera_from_clip`, rotation and translation (metres).
    pub camera_from_clip: [[f32; 4]; 3],
    /// Moment to render, seconds since the clip's time zero.
    pub time: f32,
}

/// A `LiDAR` return that projects into a view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthSample {
    /// Row-major pixel index.
    pub pixel: u32,
    /// Depth along the camera's z axis, metres.
    pub depth: f32,
}

/// What a view is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// The reconstruction may read it.
    Input,
    /// Only the figures may read it.
    HeldOut,
}

/// One image with its camera, its labels and the `LiDAR` depth of its own frame.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Index of the frame in the clip.
    pub frame: usize,
    /// Name of the camera.
    pub camera: String,
    /// Input or held out.
    pub role: Role,
    /// Camera at its own timestamp.
    pub pinhole: PinholeView,
    /// The true image.
    pub image: RgbImage,
    /// `[H, W]` labels from the clip's mask and the lens; `None` when every pixel is valid and no mask was given.
    pub labels: Option<Vec<PixelLabel>>,
    /// Nearest return of each pixel that a return of this frame's sweep projects to, ascending by pixel.
    pub depth_samples: Vec<DepthSample>,
}
