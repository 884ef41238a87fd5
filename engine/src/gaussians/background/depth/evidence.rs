//! What returns, ground and colours say about the depth of a view's pixels, before images are compared.

use super::{ground::Ground, sky_colours::SkyColours};
use crate::{
    parallel,
    points::{DepthGrid, PointCloud},
    views::{Projected, View, reduced::Reduced},
};

/// Weight of a return of another sweep, which something that was not seen to move may have left since.
const OTHER_SWEEP: f32 = 0.5;
/// Weight of what lies between two returns that agree.
const BETWEEN: f32 = 0.5;
/// Returns agree when their inverse depths differ by less than this share.
const AGREEMENT: f32 = 0.15;
/// How far a pixel looks for returns, pixels.
const REACH: usize = 14;
/// How far under the fitted plane the ground may be, metres.
const LOWERED: f32 = 0.4;
/// Distance to which the plane stands for the ground, metres.
const GROUND_RANGE: f32 = 40.0;
/// Largest difference to its neighbours, in grey levels, of a pixel that can be clear sky.
const SMOOTH: f32 = 8.0;
/// Clear sky is brighter than this share of what returns fall on.
const BRIGHTER_THAN: f32 = 0.7;
/// Strength of the sky's colour for pixels near returns.
const NEAR_RETURNS: f32 = 0.5;
/// Returns or pixels that a thread takes at once.
const GRAIN: usize = 1024;

/// What is known of one pixel; inverse depths in 1 / metres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Evidence {
    /// Inverse depth that returns tell.
    pub(super) inverse: f32,
    /// How much that counts, 0..=1; 1 for a return of the view's own sweep.
    pub(super) weight: f32,
    /// The pixel is no farther than this: there is the ground. 0 where it may be infinitely far.
    pub(super) floor: f32,
    /// Where the ground is expected, for want of returns; 0 where there are some or no ground is.
    pub(super) ground: f32,
    /// How sure it is sky, 0..=1.
    pub(super) sky: f32,
    /// Whether there are returns around the pixel.
    pub(super) near_returns: bool,
}

/// The evidence of every pixel of `level`, the reduced `view`. `[H, W]`
pub(super) fn evidence(view: &View, level: &Reduced, cloud: &PointCloud, ground: Option<Ground>) -> Vec<Evidence> {
    let mut pixels = of_returns(view, level, cloud);
    let measured: Vec<bool> = pixels.iter().map(|pixel| pixel.weight > 0.0).collect();
    interpolate(&mut pixels, level.pinhole.width);
    let mut upward = vec![false; pixels.len()];
    parallel::for_each_pair(&mut pixels, &mut upward, GRAIN, &|i, pixel, upward| {
        let at = middle(i, level.pinhole.width);
        let camera = level.pinhole.exposing([at.u, at.v]);
        let (centre, ahead) = (camera.centre(), camera.unproject(at));
        let direction: [f32; 3] = std::array::from_fn(|k| ahead[k] - centre[k]);
        if let Some(ground) = ground {
            let floor = ground.inverse_depth(centre, direction, LOWERED);
            pixel.floor = if floor > 1.0 / GROUND_RANGE { floor } else { 0.0 };
            if pixel.floor > 0.0 && !pixel.near_returns {
                pixel.ground = ground.inverse_depth(centre, direction, 0.0);
            }
        }
        *upward = direction[2] > 0.0;
    });
    mark_sky(&mut pixels, level, &measured, &upward);
    pixels
}

/// The middle of a pixel (row-major index) at a depth of one metre.
pub(super) fn middle(pixel: usize, width: usize) -> Projected {
    Projected { u: (pixel % width) as f32 + 0.5, v: (pixel / width) as f32 + 0.5, depth: 1.0 }
}

/// The best return of every pixel: of its own sweep before others, the nearest of these; what something covers is left out.
fn of_returns(view: &View, level: &Reduced, cloud: &PointCloud) -> Vec<Evidence> {
    let grid = DepthGrid::new(view.pinhole.width, view.pinhole.height, &view.depth_samples);
    let seen = |i: usize| {
        let (position, frame) = (cloud.positions[i], cloud.frames[i]);
        let place = level.pinhole.project(position)?;
        if view.pinhole.project(position).is_none_or(|at| grid.covers(at)) {
            return None;
        }
        let weight = if frame as usize == view.frame { 1.0 } else { OTHER_SWEEP };
        Some((place.pixel(level.pinhole.width), weight, 1.0 / place.depth))
    };
    let count = cloud.positions.len().min(cloud.frames.len());
    let seen: Vec<(usize, f32, f32)> = parallel::filter_map(count, GRAIN, &seen);
    let mut pixels = vec![Evidence::default(); level.pinhole.num_pixels()];
    for (pixel, weight, inverse) in seen {
        let pixel = &mut pixels[pixel];
        if (weight, inverse) > (pixel.weight, pixel.inverse) {
            *pixel = Evidence { inverse, weight, ..Evidence::default() };
        }
    }
    pixels
}

/// Fills pixels between returns, above and below or left and right, that agree; linear in inverse depth, as planes are.
fn interpolate(pixels: &mut [Evidence], width: usize) {
    let known: Vec<Evidence> = pixels.to_vec();
    let height = known.len() / width;
    parallel::for_each(pixels, GRAIN, &|i, pixel| {
        if pixel.weight > 0.0 {
            pixel.near_returns = true;
            return;
        }
        let (column, row) = (i % width, i / width);
        let find = |stride: usize, forward: bool, room: usize| {
            (1..=REACH.min(room)).find_map(|k| {
                let other = known[if forward { i + k * stride } else { i - k * stride }];
                (other.weight > 0.0).then_some((k as f32, other.inverse))
            })
        };
        let pairs = [
            (find(width, false, row), find(width, true, height - 1 - row)),
            (find(1, false, column), find(1, true, width - 1 - column)),
        ];
        let mut shortest = f32::INFINITY;
        for (before, after) in pairs {
            pixel.near_returns |= before.is_some() || after.is_some();
            let Some(((a, near), (b, far))) = before.zip(after) else { continue };
            if (near - far).abs() < AGREEMENT * near.max(far) && a + b < shortest {
                shortest = a + b;
                (pixel.inverse, pixel.weight) = ((near * b + far * a) / (a + b), BETWEEN);
            }
        }
    });
}

/// Tells sky by its colour, learned from smooth, bright pixels above the horizon and all returns.
fn mark_sky(pixels: &mut [Evidence], level: &Reduced, measured: &[bool], upward: &[bool]) {
    let colours_of = |wanted: &dyn Fn(usize) -> bool| -> Vec<[u8; 3]> {
        (0..pixels.len()).filter(|&i| wanted(i)).map(|i| level.colours[i]).collect()
    };
    let brightness = |colour: [u8; 3]| colour.iter().map(|&v| u32::from(v)).sum::<u32>();
    let solid = colours_of(&|i| measured[i]);
    let mut levels: Vec<u32> = solid.iter().map(|&colour| brightness(colour)).collect();
    levels.sort_unstable();
    let bright = levels.get(share_of(levels.len(), BRIGHTER_THAN)).copied().unwrap_or(0);
    let clear = |i: usize| upward[i] && !pixels[i].near_returns && brightness(level.colours[i]) > bright;
    let colours = SkyColours::new(&colours_of(&|i| clear(i) && roughness(level, i) < SMOOTH), &solid);
    for (i, pixel) in pixels.iter_mut().enumerate().filter(|&(i, _)| upward[i] && !measured[i]) {
        let sure = (2.0 * colours.probability(level.colours[i]) - 1.0).max(0.0);
        pixel.sky = if pixel.near_returns { NEAR_RETURNS * sure } else { sure };
    }
}

/// Largest mean difference (grey levels) of a pixel to those one and two places away in its row and column.
fn roughness(level: &Reduced, pixel: usize) -> f32 {
    let (width, height) = (level.pinhole.width, level.pinhole.height);
    let (column, row) = (pixel % width, pixel / width);
    let columns = [1, 2].map(|k| [column.saturating_sub(k), (column + k).min(width - 1)]);
    let rows = [1, 2].map(|k| [row.saturating_sub(k), (row + k).min(height - 1)]);
    let beside = columns.as_flattened().iter().map(|c| row * width + c);
    let around = beside.chain(rows.as_flattened().iter().map(|r| r * width + column));
    around.map(|other| level.difference(pixel, other)).fold(0.0, f32::max)
}

/// The index at a share (0..=1) of a sorted list's length.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a length")]
pub(super) fn share_of(len: usize, share: f32) -> usize {
    (len as f32 * share) as usize
}
