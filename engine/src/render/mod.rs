//! Exact differentiable splatting of 3D Gaussians on the CPU.

/// One Gaussian in physical values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Splat {
    /// Where it stands at `time`, metres, clip frame.
    pub mean: [f32; 3],
    /// Rotation (w, x, y, z), not normalised.
    pub quat: [f32; 4],
    /// Standard deviations along its own axes, metres.
    pub scale: [f32; 3],
    /// Opacity in 0..=1.
    pub opacity: f32,
    /// Colour in 0..=1.
    pub colour: [f32; 3],
    /// Velocity, metres a second.
    pub velocity: [f32; 3],
    /// Moment at which it stands at `mean`, seconds.
    pub time: f32,
}

/// Gradient of a scalar by the physical values of one Gaussian.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SplatGradient {
    /// By the mean.
    pub mean: [f32; 3],
    /// By the unnormalised quaternion.
    pub quat: [f32; 4],
    /// By the linear scale.
    pub scale: [f32; 3],
    /// By the opacity.
    pub opacity: f32,
    /// By the colour.
    pub colour: [f32; 3],
    /// By the velocity.
    pub velocity: [f32; 3],
}

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

/// A rendered image.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendered {
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
    /// `[H, W, 3]` colours over the background colour.
    pub rgb: Vec<f32>,
    /// `[H, W]` accumulated alpha, `1 - T`.
    pub alpha: Vec<f32>,
    /// `[H, W]` accumulated depth, `sum w z`, metres.
    pub depth: Vec<f32>,
}

/// Gradients of a scalar by the images of a [`Rendered`]; an empty vector stands for zeros.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImageGradient {
    /// `[H, W, 3]` by the colours.
    pub rgb: Vec<f32>,
    /// `[H, W]` by the accumulated alpha.
    pub alpha: Vec<f32>,
    /// `[H, W]` by the accumulated depth.
    pub depth: Vec<f32>,
    /// `[H, W]` by the expected depth, `depth / max(alpha, 1e-10)`.
    pub expected_depth: Vec<f32>,
}

impl Rendered {
    /// `[H, W]` expected depth, `depth / max(alpha, 1e-10)`, metres; 0 where nothing was drawn.
    pub fn expected_depth(&self) -> Vec<f32> {
        self.depth.iter().zip(&self.alpha).map(|(d, a)| d / a.max(1e-10)).collect()
    }
}
