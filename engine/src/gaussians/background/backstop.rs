//! A coarse layer behind everything, for the cracks that open when a view is rendered from beside its inputs.

use super::{Sheet, depth::Trust, emit::is_ignored};
use crate::{
    gaussians::{NUM_ATTRIBUTES, initial::row},
    views::{Projected, View},
};

/// Side of the blocks that get one Gaussian each, pixels.
const BLOCK: usize = 6;
/// Standard deviation, blocks.
const SIGMA_BLOCKS: f32 = 0.6;
/// Inverse depth over that of the farthest pixel around: behind slanted surfaces, too.
const BEHIND: f32 = 0.8;
/// Pixels within this factor of the farthest inverse depth give the colour.
const ALIKE: f32 = 1.2;
/// Opacity.
const OPACITY: f32 = 0.95;

/// The raw attributes of one Gaussian per block of `view`: behind the farthest point of the block and those around it, in
/// the colour of what is that far away.
pub(super) fn rows(view: &View, sheet: &Sheet) -> Vec<[f32; NUM_ATTRIBUTES]> {
    let blocks = |size: usize| (0..size).step_by(BLOCK);
    let corners =
        blocks(view.pinhole.height).flat_map(|row| blocks(view.pinhole.width).map(move |column| (row, column)));
    corners.filter_map(|corner| of_block(view, sheet, corner)).collect()
}

fn of_block(
    view: &View,
    sheet: &Sheet,
    (row_of_block, column_of_block): (usize, usize),
) -> Option<[f32; NUM_ATTRIBUTES]> {
    let pinhole = &view.pinhole;
    let around = |at: usize, size: usize| at.saturating_sub(BLOCK)..(at + 2 * BLOCK).min(size);
    let columns = around(column_of_block, pinhole.width);
    let pixels = around(row_of_block, pinhole.height).flat_map(|r| columns.clone().map(move |c| r * pinhole.width + c));
    let of_scene = |&i: &usize| {
        let known = !matches!(sheet.trust[i], Trust::OwnVehicle | Trust::Unknown);
        known && sheet.inverse_depths[i] > 0.0 && !is_ignored(view, i)
    };
    let pixels: Vec<usize> = pixels.filter(of_scene).collect();
    let farthest = pixels.iter().map(|&i| sheet.inverse_depths[i]).reduce(f32::min)?;
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for &i in pixels.iter().filter(|&&i| sheet.inverse_depths[i] <= ALIKE * farthest) {
        sum = std::array::from_fn(|k| sum[k] + view.image.data[3 * i + k]);
        count += 1.0;
    }
    let middle = |at: usize| at as f32 + 0.5 * BLOCK as f32;
    let depth = 1.0 / (BEHIND * farthest);
    let mean = pinhole.unproject(Projected { u: middle(column_of_block), v: middle(row_of_block), depth });
    Some(row(mean, SIGMA_BLOCKS * BLOCK as f32 * depth / pinhole.fx, OPACITY, sum.map(|s: f32| s / count)))
}
