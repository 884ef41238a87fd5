//! The colour of every point, from the images that see it.

use lgs_formats::image::PixelLabel;
use rayon::prelude::*;

use super::{PointCloud, occlusion::DepthGrid};
use crate::views::{Projected, Role, View};

/// Waits that differ by less than this are the same, seconds: clocks that count from an epoch are rounded.
const SAME_WAIT: f32 = 1e-4;

/// The colour (0..=1) of every point; `None` for one that no input view sees.
///
/// Views of the point's own timestamp come first, then those of the nearest other timestamp; among the views of one
/// timestamp the one that resolves the point best. A view in which something nearer covers the point gives no colour, and
/// neither does one of another timestamp whose sweep saw through it: what moves was not there then. Pixels that a mask
/// ignores give none either. Held-out views are never read.
///
/// # Shapes
/// Result `[N, 3]`.
pub fn paint(cloud: &PointCloud, views: &[View]) -> Vec<Option<[f32; 3]>> {
    let inputs: Vec<(&View, DepthGrid)> = views
        .iter()
        .filter(|view| view.role == Role::Input)
        .map(|view| (view, DepthGrid::new(view.pinhole.width, view.pinhole.height, &view.depth_samples)))
        .collect();
    let mut result = vec![None; cloud.len()];
    result.par_iter_mut().enumerate().with_min_len(1024).for_each(|(i, colour)| {
        *colour = colour_of(cloud, i, &inputs);
    });
    result
}

fn colour_of(cloud: &PointCloud, i: usize, inputs: &[(&View, DepthGrid)]) -> Option<[f32; 3]> {
    let own = |view: &View| u32::try_from(view.frame).is_ok_and(|frame| frame == cloud.frames[i]);
    let mut best: Option<([f32; 3], (f32, f32))> = None;
    for (view, grid) in inputs {
        let Some(at) = view.pinhole.project(cloud.positions[i]) else { continue };
        let wait = if own(view) { -1.0 } else { ((view.pinhole.time - cloud.times[i]).abs() / SAME_WAIT).round() };
        let footprint = at.depth / view.pinhole.fx; // metres a pixel
        if best.is_some_and(|(_, rank)| rank <= (wait, footprint)) || grid.covers(at) {
            continue;
        }
        if !own(view) && grid.sees_through(at) {
            continue;
        }
        if let Some(colour) = sample(view, at) {
            best = Some((colour, (wait, footprint)));
        }
    }
    best.map(|(colour, _)| colour)
}

/// The image's colour at `at`, bilinear over the pixels that are not ignored; `None` when the pixel itself is.
pub(crate) fn sample(view: &View, at: Projected) -> Option<[f32; 3]> {
    let (width, height) = (view.pinhole.width, view.pinhole.height);
    let ignored = |pixel: usize| view.labels.as_ref().is_some_and(|labels| labels[pixel] == PixelLabel::Ignored);
    if ignored(at.pixel(width)) {
        return None;
    }
    let (x, y) = ((at.u - 0.5).clamp(0.0, (width - 1) as f32), (at.v - 0.5).clamp(0.0, (height - 1) as f32));
    let corner = Projected { u: x, v: y, depth: at.depth }.pixel(width);
    let (fx, fy) = (x.fract(), y.fract());
    let taps = [
        (corner, (1.0 - fx) * (1.0 - fy)),
        (corner + 1, fx * (1.0 - fy)),
        (corner + width, (1.0 - fx) * fy),
        (corner + width + 1, fx * fy),
    ];
    let mut colour = [0.0; 3];
    let mut total = 0.0;
    for (pixel, weight) in taps.into_iter().filter(|&(pixel, weight)| weight > 0.0 && !ignored(pixel)) {
        let values = &view.image.data[3 * pixel..3 * pixel + 3];
        colour = std::array::from_fn(|k| colour[k] + weight * values[k]);
        total += weight;
    }
    (total > 0.0).then(|| colour.map(|c| c / total))
}
