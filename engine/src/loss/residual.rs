//! What a refinement that is guided by residuals takes back from an image to the Gaussians.

use super::{GRAIN, depth_errors, zero_ignored};
use crate::parallel;
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
    let mut rgb = differences(&rendered.rgb, &view.image.data);
    let labels = view.labels.as_deref();
    if let Some(labels) = labels {
        zero_ignored(&mut rgb, 3, labels);
    }
    let mut expected_depth = vec![0.0; rendered.depth.len()];
    for (pixel, error) in depth_errors(rendered, &view.depth_samples, labels) {
        expected_depth[pixel] = if error == 0.0 { 0.0 } else { DEPTH.copysign(error) };
    }
    ImageGradient { rgb, expected_depth, ..ImageGradient::default() }
}

/// `rendered - truth` of every value.
///
/// # Shapes
/// Both and the result `[H, W, 3]`.
pub(super) fn differences(rendered: &[f32], truth: &[f32]) -> Vec<f32> {
    let mut all = vec![0.0; rendered.len()];
    parallel::for_chunks(&mut all, GRAIN, &|number, part| {
        let pairs = rendered[number * GRAIN..].iter().zip(&truth[number * GRAIN..]);
        part.iter_mut().zip(pairs).for_each(|(difference, (r, t))| *difference = r - t);
    });
    all
}
