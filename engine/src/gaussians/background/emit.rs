//! Uncovered pixels to Gaussians.

use lgs_formats::image::PixelLabel;

use super::{Sheet, coverage::Coverage, depth::Trust};
use crate::{
    gaussians::{NUM_ATTRIBUTES, initial::row},
    points::sample,
    views::{Projected, View},
};

/// Standard deviation of a background Gaussian, pixels of its view.
const SIGMA_PX: f32 = 0.12;
/// Opacity of a background Gaussian.
const OPACITY: f32 = 0.95;

/// The raw attributes of one Gaussian per uncovered pixel of `view` whose depth is trusted just as `trust` says.
///
/// A confirmed point takes half of its colour from the first of `sources` that it projects into: neither a small error of
/// depth nor what shines differently from there then weighs fully.
pub(super) fn rows(
    view: &View,
    sheet: &Sheet,
    coverage: &Coverage,
    trust: Trust,
    sources: &[&View],
) -> Vec<[f32; NUM_ATTRIBUTES]> {
    let pinhole = &view.pinhole;
    let mut rows = Vec::new();
    for (pixel, (&inverse, &here)) in sheet.inverse_depths.iter().zip(&sheet.trust).enumerate() {
        let open = here == trust && !is_ignored(view, pixel) && coverage.shows(pixel);
        if !open || inverse.is_nan() || inverse <= 0.0 {
            continue;
        }
        let (column, line) = (pixel % pinhole.width, pixel / pinhole.width);
        let at = Projected { u: column as f32 + 0.5, v: line as f32 + 0.5, depth: 1.0 / inverse };
        let mean = pinhole.unproject(at);
        let mut colour: [f32; 3] = std::array::from_fn(|k| view.image.data[3 * pixel + k]);
        let elsewhere = |source: &&View| sample(source, source.pinhole.project(mean)?);
        if trust == Trust::Confirmed
            && let Some(other) = sources.iter().find_map(elsewhere)
        {
            colour = std::array::from_fn(|k| 0.5 * (colour[k] + other[k]));
        }
        rows.push(row(mean, SIGMA_PX * at.depth / pinhole.fx, OPACITY, colour));
    }
    rows
}

/// Whether a pixel takes part in nothing.
pub(super) fn is_ignored(view: &View, pixel: usize) -> bool {
    view.labels.as_ref().is_some_and(|labels| labels[pixel] == PixelLabel::Ignored)
}
