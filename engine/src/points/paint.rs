//! The colour of every point, from the images that see it.

use lgs_formats::image::PixelLabel;
use rayon::prelude::*;

use super::{PointCloud, occlusion::DepthGrid};
use crate::{
    parallel,
    views::{DepthSample, PinholeView, Projected, Role, View},
};

/// Waits that differ by less than this are the same, seconds: clocks that count from an epoch are rounded.
const SAME_WAIT: f32 = 1e-4;
/// Points that a thread takes at once.
const GRAIN: usize = 512;

/// The colour (0..=1) of every point; `None` for one that no input view sees.
///
/// Views of the point's own timestamp come first, then those of the nearest other timestamp; among the views of one
/// timestamp the one that resolves the point best. A view in which something nearer covers the point gives no colour, and
/// neither does one of another timestamp whose sweep saw through it: what moves was not there then. Pixels that a mask
/// ignores give none either. Held-out views are never read.
///
/// # Shapes
/// `velocities` `[N, 3]` metres a second, of points that are where they are at the moment of their sweep; result `[N, 3]`.
pub fn paint(cloud: &PointCloud, velocities: &[[f32; 3]], views: &[View]) -> Vec<Option<[f32; 3]>> {
    let inputs: Vec<&View> = views.iter().filter(|view| view.role == Role::Input).collect();
    let inputs: Vec<(&View, DepthGrid)> = parallel::map(inputs.len(), 1, &|k| {
        let view = inputs[k];
        let samples = samples_at(cloud, velocities, view);
        (view, DepthGrid::new(view.pinhole.width, view.pinhole.height, &samples))
    });
    parallel::map(cloud.len(), GRAIN, &|i| colour_of(cloud, i, velocities[i], &inputs))
}

/// The returns of a view's own sweep where they are at the moment of the view, ascending by pixel, the nearest of each.
///
/// # Shapes
/// `velocities` `[N, 3]` metres a second; frames of the cloud ascend.
pub(crate) fn samples_at(cloud: &PointCloud, velocities: &[[f32; 3]], view: &View) -> Vec<DepthSample> {
    let start = cloud.frames.partition_point(|&frame| (frame as usize) < view.frame);
    let end = cloud.frames.partition_point(|&frame| frame as usize <= view.frame);
    let place = |i: usize| (cloud.positions[i], velocities[i], cloud.times[i]);
    samples_of(end - start, &|k| place(start + k), &view.pinhole)
}

/// Where places that move, each given with its velocity and time, are at the moment of a view, ascending by pixel, the nearest of each.
pub(crate) fn samples_of(
    count: usize,
    place_of: &(dyn Fn(usize) -> ([f32; 3], [f32; 3], f32) + Sync),
    view: &PinholeView,
) -> Vec<DepthSample> {
    let sample = |i: usize| {
        let (place, velocity, time) = place_of(i);
        let at = view.project_moving(moved(place, velocity, view.time - time), velocity)?;
        Some(DepthSample { pixel: u32::try_from(at.pixel(view.width)).ok()?, depth: at.depth })
    };
    let mut samples: Vec<DepthSample> = parallel::filter_map(count, GRAIN, &sample);
    samples.par_sort_unstable_by(|a, b| a.pixel.cmp(&b.pixel).then(a.depth.total_cmp(&b.depth)));
    samples.dedup_by_key(|sample| sample.pixel);
    samples
}

/// Where a place that moves is so many seconds later, metres.
pub(crate) fn moved(place: [f32; 3], velocity: [f32; 3], seconds: f32) -> [f32; 3] {
    std::array::from_fn(|k| place[k] + velocity[k] * seconds)
}

fn colour_of(cloud: &PointCloud, i: usize, velocity: [f32; 3], inputs: &[(&View, DepthGrid)]) -> Option<[f32; 3]> {
    let own = |view: &View| u32::try_from(view.frame).is_ok_and(|frame| frame == cloud.frames[i]);
    let mut best: Option<([f32; 3], (f32, f32))> = None;
    for (view, grid) in inputs {
        let seconds = view.pinhole.time - cloud.times[i];
        let place = moved(cloud.positions[i], velocity, seconds);
        let Some(at) = view.pinhole.project_moving(place, velocity) else { continue };
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
