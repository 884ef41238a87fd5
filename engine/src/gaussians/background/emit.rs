//! Uncovered pixels to Gaussians.

use std::ops::Range;

use super::{
    Sheet,
    blocks::{Block, blocks},
    coverage::Coverage,
    depth::Trust,
};
use crate::{
    gaussians::{
        Coarseness, NUM_ATTRIBUTES,
        disc::{put, sigmas},
        initial::row,
    },
    parallel,
    points::sample,
    views::{Projected, View},
};

/// Standard deviation of a drawn background Gaussian over the sides of its rectangle of pixels.
const SIGMA_SHARE: f32 = 0.42;
/// Opacity of a background Gaussian.
const OPACITY: f32 = 0.95;
/// Share of what drawing takes from a pixel's difference to its neighbours that is given back beforehand.
const SHARPENED: f32 = 0.5;
/// Variance of a drawn Gaussian of one pixel, square pixels.
const DRAWN: f32 = 0.31;
/// Rectangles that a thread takes at once.
const GRAIN: usize = 32;

/// What is emitted of a sheet: pixels whose depth is trusted just so, in these rows of the image.
#[derive(Clone, Debug)]
pub(super) struct Wanted {
    pub(super) trust: Trust,
    pub(super) rows: Range<usize>,
}

/// The raw attributes of Gaussians for the uncovered pixels of `view` that are wanted: one for each rectangle of pixels that are alike.
///
/// A confirmed one takes half of its colour from the first of `sources` that its pixels project into: neither a small error of
/// depth nor what shines differently from there then weighs fully.
pub(super) fn rows(
    view: &View,
    sheet: &Sheet,
    coverage: &Coverage,
    wanted: Wanted,
    sources: &[&View],
    coarseness: Coarseness,
) -> Vec<[f32; NUM_ATTRIBUTES]> {
    let Wanted { trust, rows } = wanted;
    let is_open = |pixel: usize| sheet.trust[pixel] == trust && coverage.shows(pixel);
    let sources = if trust == Trust::Confirmed { sources } else { &[] };
    let blocks = blocks(view, sheet, rows, is_open, coarseness.of_image(view.pinhole.num_pixels()));
    parallel::map(blocks.len(), GRAIN, &|i| of_block(view, &blocks[i], sources))
}

/// The Gaussian of a rectangle: as wide as it, along the plane of its depths, in the mean of its colours.
fn of_block(view: &View, block: &Block, sources: &[&View]) -> [f32; NUM_ATTRIBUTES] {
    let mut made = row([0.0; 3], 1.0, OPACITY, mean_colour(view, block, sources));
    put(&mut made, &view.pinhole, block.middle(), block.plane, sigmas(block.size, SIGMA_SHARE));
    made
}

/// The mean colour of a rectangle; where at least half of its pixels project into one of `sources`, half of it from there.
fn mean_colour(view: &View, block: &Block, sources: &[&View]) -> [f32; 3] {
    let (pinhole, [middle_u, middle_v], count) = (&view.pinhole, block.middle(), block.num_pixels());
    let (mut own, mut others, mut seen) = ([0.0_f32; 3], [0.0_f32; 3], 0.0_f32);
    for pixel in block.pixels(pinhole.width) {
        let colour = sharpened(view, pixel);
        own = std::array::from_fn(|k| own[k] + colour[k]);
        let [u, v] = [(pixel % pinhole.width) as f32 + 0.5, (pixel / pinhole.width) as f32 + 0.5];
        let inverse = block.plane.inverse([u - middle_u, v - middle_v]);
        if sources.is_empty() || inverse <= 0.0 {
            continue;
        }
        let point = pinhole.unproject(Projected { u, v, depth: 1.0 / inverse });
        let elsewhere = |source: &&View| sample(source, source.pinhole.project(point)?);
        if let Some(other) = sources.iter().find_map(elsewhere) {
            others = std::array::from_fn(|k| others[k] + other[k]);
            seen += 1.0;
        }
    }
    if seen < 0.5 * count {
        return own.map(|sum| sum / count);
    }
    std::array::from_fn(|k| 0.5 * (own[k] / count + others[k] / seen))
}

/// The colour of a pixel, away from what a drawn Gaussian would make of it and its neighbours.
fn sharpened(view: &View, pixel: usize) -> [f32; 3] {
    let (width, height) = (view.pinhole.width, view.pinhole.height);
    let (column, row) = (pixel % width, pixel / width);
    let colour = |pixel: usize| -> [f32; 3] { std::array::from_fn(|k| view.image.data[3 * pixel + k]) };
    let beside = (-0.5 / DRAWN).exp();
    let (mut sum, mut total) = ([0.0_f32; 3], 0.0_f32);
    for r in row.saturating_sub(1)..(row + 2).min(height) {
        for c in column.saturating_sub(1)..(column + 2).min(width) {
            let weight = match r.abs_diff(row) + c.abs_diff(column) {
                0 => 1.0,
                1 => beside,
                _ => beside * beside,
            };
            let here = colour(r * width + c);
            sum = std::array::from_fn(|k| sum[k] + weight * here[k]);
            total += weight;
        }
    }
    let own = colour(pixel);
    std::array::from_fn(|k| (own[k] + SHARPENED * (own[k] - sum[k] / total)).clamp(0.0, 1.0))
}
