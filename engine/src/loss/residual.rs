//! What a refinement that is guided by residuals takes back from an image to the Gaussians.

use lgs_formats::image::PixelLabel;
use rayon::prelude::*;

use super::{GRAIN, depth_errors};
use crate::render::{ImageGradient, Rendered};
use crate::views::View;

/// What a wrong depth counts as, of a range of colours of 1.
pub(super) const DEPTH: f32 = 0.003;

/// Errors of a rendered view by pixel: those of its colours, which are the gradient of half their squares, and by the expected depth a
/// constant towards the `LiDAR` depth.
///
/// # Shapes
/// `rendered` has the size of `view`. `rgb` `[H, W, 3]`, `expected_depth` `[H, W]`; zero where the pixel is ignored.
///
/// # Formula
/// `rendered - truth`; `0.003 sign(expected depth - LiDAR)`.
pub fn residual_image(rendered: &Rendered, view: &View) -> ImageGradient {
    let mut rgb: Vec<f32> =
        rendered.rgb.par_iter().zip(&view.image.data).with_min_len(GRAIN).map(|(r, t)| r - t).collect();
    let labels = view.labels.as_deref();
    if let Some(labels) = labels {
        let ignored = rgb
            .par_chunks_exact_mut(3)
            .zip(labels)
            .with_min_len(GRAIN)
            .filter(|(_, label)| **label == PixelLabel::Ignored);
        ignored.for_each(|(residual, _)| residual.fill(0.0));
    }
    let mut expected_depth = vec![0.0; rendered.depth.len()];
    for (pixel, error) in depth_errors(rendered, &view.depth_samples, labels) {
        expected_depth[pixel] = if error == 0.0 { 0.0 } else { DEPTH.copysign(error) };
    }
    ImageGradient { rgb, expected_depth, ..ImageGradient::default() }
}
