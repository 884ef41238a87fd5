//! Views: what one camera saw at one moment, at the size and in the frame that the reconstruction works in.

mod clip_frame;
mod load;
mod path;
mod pinhole;
pub(crate) mod reduced;
mod response;
#[cfg(test)]
pub(crate) mod samples;
mod selection;
mod shrink;
pub(crate) mod shutter;
mod stray;
mod strided;

use lgs_formats::image::{DepthMap, PixelLabel, RgbImage};

pub use clip_frame::ClipFrame;
pub(crate) use load::load_views;
pub use path::{between, keys_of_camera, path_views};
pub use pinhole::{NEAR, PinholeView, Projected};
pub use response::Response;
pub(crate) use response::{light, off_axis};
pub use selection::{SelectedFrames, Selection};
pub use shutter::Shutter;
pub(crate) use stray::{Stray, strays};
pub(crate) use strided::strided;

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
    /// Camera at its own timestamp, its shutter included.
    pub pinhole: PinholeView,
    /// The image: as the camera took it, or, of an input view with a response, of common colours.
    pub image: RgbImage,
    /// How the camera shows the common colours of `image`; `None` where these are its own.
    pub response: Option<Response>,
    /// `[H, W]` labels from the clip's mask and the lens; `None` when every pixel is valid and no mask was given.
    pub labels: Option<Vec<PixelLabel>>,
    /// `[H, W]` the clip's depth map of an input view, where it has one.
    pub depth_map: Option<DepthMap>,
    /// Nearest return of each pixel that a return of this frame's sweep projects to, ascending by pixel.
    pub depth_samples: Vec<DepthSample>,
}
