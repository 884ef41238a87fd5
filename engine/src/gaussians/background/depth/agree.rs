//! Which depths the map of another view confirms, and what to believe where none does.

use super::relative::RelativePose;
use crate::{
    parallel,
    views::{PinholeView, reduced::Reduced},
};

/// Maps agree within this many labels of the other one plus this share of the inverse depth.
const TOLERANCE: (f32, f32) = (1.5, 0.05);
/// How far an unconfirmed pixel looks for a confirmed one, pixels.
const REACH: usize = 30;
/// What a pixel of distance costs when looking, grey levels.
const PER_PIXEL: f32 = 3.0;
/// What nearness costs, grey levels times metres: what is hidden in another view is more often behind than in front.
const PER_INVERSE_DEPTH: f32 = 600.0;
/// Pixels that a thread takes at once.
const GRAIN: usize = 512;

/// How far a pixel's depth can be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(in super::super) enum Trust {
    /// Another view's map, or a return, says the same.
    Confirmed,
    /// No other view sees the point: it is hidden there, or outside.
    Alone,
    /// Another view sees through the point.
    Contradicted,
    /// No point of the scene: the own vehicle, at about this depth.
    OwnVehicle,
    /// The depth is not known.
    Unknown,
}

/// A depth map: a view's camera, its inverse depths (1 / metres, NaN for none) and their resolution.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Map<'a> {
    /// The camera.
    pub(in super::super) camera: &'a PinholeView,
    /// `[H, W]`
    pub(in super::super) inverse: &'a [f32],
    /// Inverse depth between two labels.
    pub(in super::super) step: f32,
}

/// The trust in every pixel of `map`, given the maps of the views that it was matched against. `[H, W]`
pub(in super::super) fn trust(map: Map<'_>, others: &[Map<'_>]) -> Vec<Trust> {
    let poses: Vec<RelativePose> = others.iter().map(|other| RelativePose::new(map.camera, other.camera)).collect();
    let of_pixel = |pixel: usize| {
        let inverse = map.inverse[pixel];
        if inverse.is_nan() {
            return Trust::Unknown;
        }
        let verdicts = others.iter().zip(&poses).filter_map(|(other, pose)| {
            let at = pose.transfer(map.camera, pixel, inverse, other.camera)?;
            let seen = other.inverse[at.pixel(other.camera.width)];
            let gap = 1.0 / at.depth - seen;
            let near = gap.abs() < TOLERANCE.0 * other.step + TOLERANCE.1 * seen;
            Some(if seen.is_nan() || (!near && gap < 0.0) {
                Trust::Alone
            } else if near {
                Trust::Confirmed
            } else {
                Trust::Contradicted
            })
        });
        verdicts.reduce(better).unwrap_or(Trust::Alone)
    };
    parallel::map(map.inverse.len(), GRAIN, &of_pixel)
}

/// A confirmation by one view is enough; else being seen through by one view is.
fn better(a: Trust, b: Trust) -> Trust {
    if a == Trust::Confirmed || b == Trust::Confirmed { Trust::Confirmed } else { a.max(b) }
}

/// The inverse depths, those of unconfirmed pixels taken from the likeliest confirmed pixel around. `[H, W]`
pub(super) fn repaired(view: &Reduced, inverse: &[f32], trust: &[Trust]) -> Vec<f32> {
    let of_pixel = |pixel: usize| match trust[pixel] {
        Trust::Alone | Trust::Contradicted => nearest_confirmed(view, pixel, inverse, trust).unwrap_or(inverse[pixel]),
        Trust::Confirmed | Trust::OwnVehicle | Trust::Unknown => inverse[pixel],
    };
    parallel::map(inverse.len(), GRAIN, &of_pixel)
}

/// The inverse depth of that of the first confirmed pixels in eight directions which is most alike, close and far away.
fn nearest_confirmed(view: &Reduced, pixel: usize, inverse: &[f32], trust: &[Trust]) -> Option<f32> {
    let (width, height) = (view.pinhole.width, view.pinhole.height);
    let (column, row) = (pixel % width, pixel / width);
    let walk = |position: usize, direction: usize, k: usize, size: usize| match direction {
        0 => position.checked_sub(k),
        1 => Some(position),
        _ => Some(position + k).filter(|&p| p < size),
    };
    let mut best: Option<(f32, f32)> = None;
    for direction in (0..9).filter(|&d| d != 4) {
        let found = (1..=REACH).find_map(|k| {
            let other = walk(row, direction / 3, k, height)? * width + walk(column, direction % 3, k, width)?;
            (trust[other] == Trust::Confirmed).then_some((k, other))
        });
        let Some((distance, other)) = found else { continue };
        let cost = view.difference(pixel, other) + PER_PIXEL * distance as f32 + PER_INVERSE_DEPTH * inverse[other];
        if best.is_none_or(|(least, _)| cost < least) {
            best = Some((cost, inverse[other]));
        }
    }
    best.map(|(_, inverse)| inverse)
}
