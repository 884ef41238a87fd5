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

    /// Whether the sweep saw through `at`: there are returns around it and all of them lie well behind.
    pub(crate) fn sees_through(&self, at: Projected) -> bool {
        let nearest = self.window(at).map(|(_, _, depth)| depth).fold(f32::INFINITY, f32::min);
        nearest.is_finite() && nearest * NEARER > at.depth
    }

    /// Whether nearer returns lie around `at` on opposite sides, so that what they belong to covers it.
    ///
    /// One side alone does not count: on a road seen at a grazing angle every return has nearer ones below it, and beside
    /// the outline of a car every return of the wall behind has nearer ones on one side.
    pub(crate) fn covers(&self, at: Projected) -> bool {
        let limit = at.depth * NEARER;
        let mut sides = 0_u8;
        for (x, y, _) in self.window(at).filter(|&(_, _, depth)| depth < limit) {
            sides |= octant(x - at.u, y - at.v);
        }
        sides & sides.rotate_left(4) != 0
    }

    /// Centre (pixels) and depth (metres) of every pixel around `at`.
    fn window(&self, at: Projected) -> impl Iterator<Item = (f32, f32, f32)> + '_ {
        let pixel = at.pixel(self.width);
        let (row, column) = (pixel / self.width, pixel % self.width);
        let columns = column.saturating_sub(REACH)..(column + REACH + 1).min(self.width);
        let rows = row.saturating_sub(REACH)..(row + REACH + 1).min(self.height);
        rows.flat_map(move |r| {
            columns.clone().map(move |c| (c as f32 + 0.5, r as f32 + 0.5, self.depths[r * self.width + c]))
        })
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

#[cfg(test)]
mod tests {
    use super::DepthGrid;
    use crate::views::{DepthSample, Projected};

    fn grid(depths: &[(u32, f32)]) -> DepthGrid {
        let samples: Vec<DepthSample> = depths.iter().map(|&(pixel, depth)| DepthSample { pixel, depth }).collect();
        DepthGrid::new(20, 20, &samples)
    }

    fn at(depth: f32) -> Projected {
        Projected { u: 10.5, v: 10.5, depth }
    }

    #[test]
    fn what_stands_behind_a_surface_is_covered() {
        let surface = grid(&[(9 * 20 + 10, 5.0), (12 * 20 + 10, 5.0)]);
        assert!(surface.covers(at(10.0)));
        assert!(!surface.covers(at(5.2)));
        assert!(!grid(&[(9 * 20 + 10, 5.0)]).covers(at(10.0)), "one side alone is the slope of a road");
    }

    #[test]
    fn a_sweep_sees_through_what_was_not_there() {
        let surface = grid(&[(9 * 20 + 10, 5.0), (12 * 20 + 10, 20.0)]);
        assert!(surface.sees_through(at(1.0)));
        assert!(!surface.sees_through(at(4.9)));
        assert!(!grid(&[]).sees_through(at(1.0)), "without returns nothing is known");
    }
}
