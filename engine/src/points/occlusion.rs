//! Which points of a scene a camera sees, judged by sparse depth samples.

use crate::views::{DepthSample, Projected};

/// Half width of the window in which nearer returns can cover a point, pixels.
const REACH: usize = 6;
/// A return covers a point when it is nearer than this share of the point's depth.
const NEARER: f32 = 0.9;

/// The nearest return of every pixel of a view.
#[derive(Clone, Debug)]
pub(crate) struct DepthGrid {
    width: usize,
    height: usize,
    /// `[H, W]` metres; infinite where no return projects to.
    depths: Vec<f32>,
}

impl DepthGrid {
    /// The grid of a view of `width` x `height` pixels.
    pub(crate) fn new(width: usize, height: usize, samples: &[DepthSample]) -> Self {
        let mut depths = vec![f32::INFINITY; width * height];
        for sample in samples {
            if let Some(cell) = depths.get_mut(sample.pixel as usize) {
                *cell = cell.min(sample.depth);
            }
        }
        Self { width, height, depths }
    }

    /// Whether nearer returns lie around `at` on opposite sides, so that what they belong to covers it.
    ///
    /// One side alone does not count: on a road seen at a grazing angle every return has nearer ones below it, and beside
    /// the outline of a car every return of the wall behind has nearer ones on one side.
    pub(crate) fn covers(&self, at: Projected) -> bool {
        let limit = at.depth * NEARER;
        let pixel = at.pixel(self.width);
        let (row, column) = (pixel / self.width, pixel % self.width);
        let mut sides = 0_u8;
        for r in row.saturating_sub(REACH)..(row + REACH + 1).min(self.height) {
            for c in column.saturating_sub(REACH)..(column + REACH + 1).min(self.width) {
                if self.depths[r * self.width + c] < limit {
                    sides |= octant(c as f32 + 0.5 - at.u, r as f32 + 0.5 - at.v);
                }
            }
        }
        sides & sides.rotate_left(4) != 0
    }
}

/// The bit of the eighth of the circle around the origin in which (x, y) lies; the opposite one is four places away.
fn octant(x: f32, y: f32) -> u8 {
    let half = if y < 0.0 || (y == 0.0 && x < 0.0) { 4 } else { 0 };
    let (x, y) = if half == 4 { (-x, -y) } else { (x, y) };
    let turn = match (x > 0.0, x.abs() > y) {
        (true, true) => 0,
        (true, false) => 1,
        (false, false) => 2,
        (false, true) => 3,
    };
    1 << (half + turn)
}
