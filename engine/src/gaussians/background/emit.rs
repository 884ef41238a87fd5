//! Uncovered pixels to Gaussians.

use lgs_formats::image::PixelLabel;

use super::{Sheet, coverage::Coverage};
use crate::{
    gaussians::{NUM_ATTRIBUTES, initial::row},
    views::{Projected, View},
};

/// Standard deviation of a background Gaussian, pixels of its view.
const SIGMA_PX: f32 = 0.5;
/// Opacity of a background Gaussian.
const OPACITY: f32 = 0.95;

/// The raw attributes of one Gaussian per uncovered pixel of `view` whose depth is known.
pub(super) fn rows(view: &View, sheet: &Sheet, coverage: &Coverage) -> Vec<[f32; NUM_ATTRIBUTES]> {
    let pinhole = &view.pinhole;
    let mut rows = Vec::new();
    for (pixel, &inverse) in sheet.0.iter().enumerate() {
        let ignored = view.labels.as_ref().is_some_and(|labels| labels[pixel] == PixelLabel::Ignored);
        if inverse.is_nan() || ignored || !coverage.shows(pixel) {
            continue;
        }
        let (column, line) = (pixel % pinhole.width, pixel / pinhole.width);
        let at = Projected { u: column as f32 + 0.5, v: line as f32 + 0.5, depth: 1.0 / inverse };
        let colour = std::array::from_fn(|k| view.image.data[3 * pixel + k]);
        rows.push(row(pinhole.unproject(at), SIGMA_PX / (inverse * pinhole.fx), OPACITY, colour));
    }
    rows
}
