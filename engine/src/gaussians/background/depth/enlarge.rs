//! Depth maps back at the resolution of their views.

use rayon::prelude::*;

use super::agree::Trust;
use crate::{
    gaussians::background::{Sheet, slant},
    views::{View, reduced::Reduced},
};

/// What a pixel of distance costs when the coarse pixel of the most similar colour is sought, grey levels of all channels.
const PER_PIXEL: f32 = 2.0;
/// Pixels that a thread takes at once.
const GRAIN: usize = 1024;

/// The sheet of `view`: each pixel takes inverse depth and trust of that of the four coarse pixels around it which is most
/// like it; nothing is farther away than `radius` metres.
pub(super) fn enlarged(
    view: &View,
    level: &Reduced,
    factor: usize,
    inverse: &[f32],
    trust: &[Trust],
    radius: f32,
) -> Sheet {
    let pinhole = &view.pinhole;
    let (inverse_depths, trust) = (0..pinhole.num_pixels())
        .into_par_iter()
        .with_min_len(GRAIN)
        .map(|pixel| {
            let coarse = most_alike(view, level, factor, pixel);
            (inverse[coarse].max(slant(pinhole, pixel) / radius), trust[coarse])
        })
        .unzip();
    Sheet { inverse_depths, trust }
}

fn most_alike(view: &View, level: &Reduced, factor: usize, pixel: usize) -> usize {
    let (width, height) = (level.pinhole.width, level.pinhole.height);
    let colour: [f32; 3] = std::array::from_fn(|k| 255.0 * view.image.data[3 * pixel + k]);
    // Twice the factor times the coarse position of the pixel's centre, so that whole numbers do.
    let place = |at: usize, size: usize| {
        let doubled = (2 * at + 1).saturating_sub(factor);
        let low = (doubled / (2 * factor)).min(size - 1);
        [low, (low + 1).min(size - 1)].map(|c| (c, doubled.abs_diff(2 * factor * c) as f32 / (2 * factor) as f32))
    };
    let columns = place(pixel % view.pinhole.width, width);
    let rows = place(pixel / view.pinhole.width, height);
    let mut best = (f32::INFINITY, 0);
    for (row, dy) in rows {
        for (column, dx) in columns {
            let coarse = row * width + column;
            let other = level.colours[coarse];
            let gap: f32 = (0..3).map(|k| (colour[k] - f32::from(other[k])).abs()).sum();
            let cost = gap + PER_PIXEL * (dx + dy);
            if cost < best.0 {
                best = (cost, coarse);
            }
        }
    }
    best.1
}
