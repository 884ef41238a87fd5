//! The loss of a view as exact effects need it.

use lgs_formats::casts::to_f32;
use lgs_formats::image::PixelLabel;

use super::residual::differences;
use super::ssim::{ImagePair, add_ssim_gradient};
use super::{LossCounts, LossWeights, counted_pixels, depth_errors, fill_ignored, zero_ignored};
use crate::render::{PixelCosts, Rendered};
use crate::views::View;

/// What the pixels of a rendered view cost: absolute errors of colour and depth as they are, the similarity by its gradient.
///
/// # Shapes
/// `rendered` has the size of `view`.
///
/// # Formula
/// In units of [`image_loss`](super::image_loss): `per_colour = l1 / (3 pixels)`, `slopes = -ssim d SSIM / d colour`,
/// `per_depth = depth / samples`.
pub fn pixel_costs(rendered: &Rendered, view: &View, weights: &LossWeights) -> PixelCosts {
    let labels = view.labels.as_deref();
    let ignored = |pixel: usize| labels.is_some_and(|labels| labels[pixel] == PixelLabel::Ignored);
    let (width, height) = (rendered.width, rendered.height);
    let mut colours = Vec::new();
    fill_ignored(&rendered.rgb, &view.image.data, labels.unwrap_or_default(), &mut colours);
    let mut slopes = vec![0.0; colours.len()];
    let pair = ImagePair { truth: &view.image.data, rendered: &colours, width, height };
    let similarity = add_ssim_gradient(&pair, labels, -weights.ssim, &mut slopes);
    zero_ignored(&mut slopes, 3, labels.unwrap_or_default());
    let mut depth = vec![0.0; rendered.depth.len()];
    let samples = view.depth_samples.iter().map(|sample| (sample.pixel as usize, sample.depth));
    samples.filter(|&(pixel, _)| !ignored(pixel)).for_each(|(pixel, metres)| depth[pixel] = metres);
    let counts = LossCounts::of(view);
    let per = |sums| to_f32(counts.loss(weights, sums));
    let residual = differences(&colours, &view.image.data);
    let by_colour = residual.iter().map(|r| f64::from(r.abs())).sum::<f64>();
    let by_depth = depth_errors(rendered, &view.depth_samples, labels).map(|(_, e)| f64::from(e.abs())).sum::<f64>();
    let dissimilarity = similarity.map_or(0.0, |similarity| 1.0 - similarity);
    PixelCosts {
        loss: counts.loss(weights, [by_colour, 0.0, by_depth]) + f64::from(weights.ssim) * dissimilarity,
        residual,
        counted: counted_pixels(view),
        per_colour: per([1.0, 0.0, 0.0]),
        per_square: 0.0,
        slopes,
        depth,
        per_depth: per([0.0, 0.0, 1.0]),
    }
}
