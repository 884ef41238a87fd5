//! Depths for a view's uncovered pixels from the returns around them.
//!
//! Holes between and beside returns continue what surrounds them: inverse depths are averaged over ever larger blocks and each pixel takes
//! them from the finest blocks that know one (pull-push). What stands above the highest beam so continues the returns below it.
//!
//! # Source
//! Gortler et al., The lumigraph, 1996 (pull-push); inverse depth because planes are linear in it.

use super::{Sheet, depth::Trust, slant};
use crate::{
    parallel,
    views::{DepthSample, View},
};

/// Weight at which a block's own returns count fully, returns.
const ENOUGH: f32 = 1.0;

/// Inverse depths and their weights on a grid.
struct Grid {
    width: usize,
    height: usize,
    /// `[H, W]` of (sum of weighted inverse depths, weight).
    cells: Vec<(f32, f32)>,
}

/// Inverse depths of the views' pixels, nowhere farther than `radius` metres.
pub(super) fn sheets(views: &[&View], radius: f32) -> Vec<Sheet> {
    parallel::map(views.len(), 1, &|i| sheet(views[i], radius))
}

fn sheet(view: &View, radius: f32) -> Sheet {
    let filled = continued([view.pinhole.width, view.pinhole.height], &view.depth_samples, 1.0 / radius);
    let near_enough = |(pixel, w): (usize, f32)| w.max(slant(&view.pinhole, pixel) / radius);
    let inverse_depths: Vec<f32> = filled.into_iter().enumerate().map(near_enough).collect();
    Sheet { trust: vec![Trust::Alone; inverse_depths.len()], inverse_depths }
}

/// The inverse depths of the pixels of an image of a width and height as some samples continue; `fallback` where there is none. `[H, W]`
pub(super) fn continued(size: [usize; 2], samples: &[DepthSample], fallback: f32) -> Vec<f32> {
    let mut levels = vec![Grid::of_returns(size, samples)];
    while let Some(finest) = levels.last().filter(|grid| grid.width.max(grid.height) > 1) {
        let coarser = finest.halved();
        levels.push(coarser);
    }
    let mut filled = levels.pop().map_or_else(Vec::new, |top| top.own(fallback));
    let mut coarser = [1, 1];
    while let Some(grid) = levels.pop() {
        filled = grid.filled(&filled, coarser);
        coarser = [grid.width, grid.height];
    }
    filled
}

impl Grid {
    fn of_returns([width, height]: [usize; 2], samples: &[DepthSample]) -> Self {
        let mut cells = vec![(0.0, 0.0); width * height];
        for sample in samples {
            if let Some(cell) = cells.get_mut(sample.pixel as usize) {
                *cell = (1.0 / sample.depth, 1.0);
            }
        }
        Self { width, height, cells }
    }

    /// Sums over blocks of 2 x 2, the weight capped so that a block with many returns does not drown its neighbours.
    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut cells = vec![(0.0, 0.0); width * height];
        for (i, &(sum, weight)) in self.cells.iter().enumerate() {
            let cell: &mut (f32, f32) = &mut cells[i / self.width / 2 * width + i % self.width / 2];
            *cell = (cell.0 + sum, cell.1 + weight);
        }
        for cell in cells.iter_mut().filter(|cell| cell.1 > ENOUGH) {
            *cell = (cell.0 / cell.1 * ENOUGH, ENOUGH);
        }
        Self { width, height, cells }
    }

    fn own(&self, fallback: f32) -> Vec<f32> {
        self.cells.iter().map(|&(sum, weight)| if weight > 0.0 { sum / weight } else { fallback }).collect()
    }

    /// The cells' own values where they have enough weight, mixed with the coarser grid's, bilinear, where not.
    fn filled(&self, coarse: &[f32], [width, height]: [usize; 2]) -> Vec<f32> {
        let value = |i: usize| {
            let (sum, weight) = self.cells[i];
            if weight >= ENOUGH {
                return sum / weight;
            }
            // A fine cell's centre lies a quarter of a coarse cell beside the nearer coarse centre.
            let place = |at: usize, size: usize| {
                let low = at.saturating_sub(1) / 2;
                let share = if at == 0 { 0.0 } else { 0.25 + 0.5 * ((at + 1) % 2) as f32 };
                (low.min(size - 1), (low + 1).min(size - 1), share)
            };
            let (x0, x1, fx) = place(i % self.width, width);
            let (y0, y1, fy) = place(i / self.width, height);
            let line = |y: usize| coarse[y * width + x0] * (1.0 - fx) + coarse[y * width + x1] * fx;
            let around = line(y0) * (1.0 - fy) + line(y1) * fy;
            sum + (1.0 - weight / ENOUGH) * around
        };
        (0..self.cells.len()).map(value).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::sheet;
    use crate::views::{
        DepthSample, View,
        samples::{ahead, seen},
    };

    fn view(depth_samples: Vec<DepthSample>) -> View {
        View { depth_samples, ..seen(ahead(20, 12, 10.0), vec![0.5; 720]) }
    }

    #[test]
    fn returns_keep_their_depth_and_holes_lie_between_them() {
        let samples = vec![DepthSample { pixel: 0, depth: 4.0 }, DepthSample { pixel: 239, depth: 8.0 }];
        let sheet = sheet(&view(samples), 100.0).inverse_depths;
        assert_eq!((sheet[0], sheet[239]), (0.25, 0.125));
        assert!(sheet.iter().all(|w| (0.12..=0.26).contains(w)), "{sheet:?}");
        assert!(sheet[22] > sheet[217], "{} {}", sheet[22], sheet[217]);
    }

    #[test]
    fn without_returns_all_is_far() {
        let sheet = sheet(&view(Vec::new()), 50.0).inverse_depths;
        assert!(sheet.iter().all(|w| (0.02..0.04).contains(w)), "{sheet:?}");
    }

    #[test]
    fn nothing_is_farther_than_the_radius() {
        let sheet = sheet(&view(vec![DepthSample { pixel: 110, depth: 1e6 }]), 50.0).inverse_depths;
        assert!(sheet.iter().all(|&w| w >= 0.02), "{sheet:?}");
    }
}
