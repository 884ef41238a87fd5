//! Images on the host.

/// An RGB image with values in 0..=1, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbImage {
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
    /// `[H, W, 3]` values in 0..=1.
    pub data: Vec<f32>,
}

/// What a pixel of a mask file says. Grey value 0: ignored (own vehicle, outside the lens); 255: static; any
/// other value: a moving object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelLabel {
    /// Takes part in nothing: neither loss nor figures nor colours.
    Ignored,
    /// Belongs to a moving object.
    Dynamic,
    /// Belongs to the static scene.
    Static,
}

/// A decoded, undistorted, resized image with what its mask says.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedImage {
    /// The colours.
    pub rgb: RgbImage,
    /// `[H, W]` labels; `None` when every pixel is valid and the clip brings no mask.
    pub labels: Option<Vec<PixelLabel>>,
    /// The camera of `rgb`: rectified, at the size of `rgb`.
    pub camera: crate::camera::Camera,
}
