//! Exact differentiable splatting of 3D Gaussians on the CPU.

pub mod reference;

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
