//! Whether a pixel is nearer to the returns of a moving thing or to those of all else.

use super::outline::Outline;
use crate::views::DepthSample;

/// What the nearest returns count, beside colours.
const RETURNS: f32 = 0.05;
/// Share of the height of a thing over which its returns lose their say.
const FADES: f32 = 0.25;

/// How far pixels are from the returns of the thing, and from those of all else.
pub(super) struct Nearest {
    own: Vec<f32>,
    other: Vec<f32>,
}

impl Nearest {
    /// Those of the pixels of an outline in an image of a width. `own` and `others`: where the returns of the thing and of all else are in it.
    pub(super) fn of<'a>(
        outline: &Outline,
        width: usize,
        own: &[DepthSample],
        others: impl Iterator<Item = &'a DepthSample> + Send,
    ) -> Self {
        let (own, other) = rayon::join(
            || distances(outline, &outline.marked(width, own.iter())),
            || distances(outline, &outline.marked(width, others)),
        );
        Self { own, other }
    }

    /// What the nearest returns say, in units of a difference of colours.
    pub(super) fn prior(&self, outline: &Outline, pixel: usize, width: usize) -> f32 {
        let index = outline.index(pixel / width, pixel % width);
        let (own, other) = (self.own[index], self.other[index]);
        let share = if other.is_finite() { (other - own) / (other + own).max(1e-3) } else { 1.0 };
        RETURNS * (share - own / (FADES * outline.height).max(1.0))
    }
}

/// The distance of each pixel of an outline from the nearest seed in it, pixels: a chamfer distance in two passes.
fn distances(outline: &Outline, seeds: &[bool]) -> Vec<f32> {
    let mut found: Vec<f32> = seeds.iter().map(|&seed| if seed { 0.0 } else { f32::INFINITY }).collect();
    let (columns, rows) = (outline.columns.len(), outline.rows.len());
    let diagonal = std::f32::consts::SQRT_2;
    for forward in [true, false] {
        for step in 0..rows * columns {
            let at = if forward { step } else { rows * columns - 1 - step };
            let (row, column) = (at / columns, at % columns);
            let mut best = found[at];
            let mut take = |known: bool, index: usize, far: f32| {
                if known {
                    best = best.min(found[index] + far);
                }
            };
            if forward {
                take(column > 0, at.wrapping_sub(1), 1.0);
                take(row > 0, at.wrapping_sub(columns), 1.0);
                take(row > 0 && column > 0, at.wrapping_sub(columns + 1), diagonal);
                take(row > 0 && column + 1 < columns, at.wrapping_sub(columns - 1), diagonal);
            } else {
                take(column + 1 < columns, at + 1, 1.0);
                take(row + 1 < rows, at + columns, 1.0);
                take(row + 1 < rows && column + 1 < columns, at + columns + 1, diagonal);
                take(row + 1 < rows && column > 0, at + columns - 1, diagonal);
            }
            found[at] = best;
        }
    }
    found
}
