//! A coarse layer behind everything, for the cracks that open when a view is rendered from beside its inputs.

use super::{Sheet, depth::Trust, is_ignored};
use crate::{
    gaussians::{Coarseness, NUM_ATTRIBUTES, initial::row},
    parallel,
    views::{Projected, View},
};

/// Side of the smallest blocks that get one Gaussian each, pixels.
const BLOCK: usize = 6;
/// How often four blocks become one, unless a scene is to be the finest.
const DOUBLINGS: u32 = 2;
/// Standard deviation, blocks.
const SIGMA_BLOCKS: f32 = 0.6;
/// Inverse depth over that of the farthest pixel around: behind slanted surfaces, too.
const BEHIND: f32 = 0.8;
/// Pixels within this factor of the farthest inverse depth give the colour.
const ALIKE: f32 = 1.2;
/// Largest difference between the inverse depths of four blocks that become one, a share of the smallest, at a coarseness of 1.
const SAME_DEPTH: f32 = 0.25;
/// Largest difference of a channel of their colours, at a coarseness of 1.
const SAME_COLOUR: f32 = 0.06;
/// Opacity.
const OPACITY: f32 = 0.95;
/// Blocks that a thread takes at once.
const GRAIN: usize = 64;

/// What is behind a block.
#[derive(Clone, Copy, Debug)]
struct Behind {
    /// Inverse depth of the farthest pixel in and around it, 1 / metres.
    farthest: f32,
    /// Colour of what is that far away.
    colour: [f32; 3],
}

/// Blocks of one size over an image; `None` for those that are no more, or that show nothing of the scene.
struct Grid {
    side: usize,
    columns: usize,
    cells: Vec<Option<Behind>>,
}

/// The raw attributes of one Gaussian per block of `view`: behind the farthest point of the block and those around it, in
/// the colour of what is that far away. Four blocks behind which there is the same become one.
pub(super) fn rows(view: &View, sheet: &Sheet, coarseness: Coarseness) -> Vec<[f32; NUM_ATTRIBUTES]> {
    let coarseness = coarseness.of_image(view.pinhole.num_pixels());
    let mut grids = vec![Grid::finest(view, sheet)];
    let doublings = if coarseness == Coarseness::FINEST { 0 } else { DOUBLINGS };
    for _ in 0..doublings {
        let next = grids.last_mut().map(|grid| grid.doubled(coarseness.factor()));
        grids.extend(next);
    }
    grids.iter().flat_map(|grid| grid.rows(view)).collect()
}

impl Grid {
    fn finest(view: &View, sheet: &Sheet) -> Self {
        let [columns, rows] = [view.pinhole.width, view.pinhole.height].map(|size| size.div_ceil(BLOCK));
        let cell = |i: usize| of_block(view, sheet, i / columns * BLOCK, i % columns * BLOCK);
        let cells = parallel::map(columns * rows, GRAIN, &cell);
        Self { side: BLOCK, columns, cells }
    }

    /// The grid of blocks of twice the side where four are alike; these are taken out here.
    fn doubled(&mut self, factor: f32) -> Self {
        let rows = self.cells.len() / self.columns.max(1);
        let (columns, rows) = (self.columns / 2, rows / 2);
        let (before, self_columns) = (self.cells.clone(), self.columns);
        // What is drawn that wide reaches into the blocks around: nothing farther may be there, nor may the image end.
        let reaches_past = |i: usize, farthest: f32| {
            let (row, column) = (2 * (i / columns), 2 * (i % columns));
            let inside = row > 0 && column > 0 && (row + 2) < before.len() / self_columns && column + 2 < self_columns;
            let cell = |k: usize| before[(row + k / 4 - 1) * self_columns + column + k % 4 - 1];
            !inside
                || (0..16).any(|k| cell(k).is_none_or(|other| (1.0 + factor * SAME_DEPTH) * other.farthest < farthest))
        };
        let of_four = |i: usize| {
            let corner = i / columns * 2 * self.columns + i % columns * 2;
            let places = [corner, corner + 1, corner + self.columns, corner + self.columns + 1];
            let [Some(a), Some(b), Some(c), Some(d)] = places.map(|place| self.cells[place]) else { return None };
            let joined = joined([a, b, c, d], factor).filter(|joined| !reaches_past(i, joined.farthest))?;
            places.iter().for_each(|&place| self.cells[place] = None);
            Some(joined)
        };
        Self { side: 2 * self.side, columns, cells: (0..columns * rows).map(of_four).collect() }
    }

    fn rows(&self, view: &View) -> impl Iterator<Item = [f32; NUM_ATTRIBUTES]> {
        let side = self.side as f32;
        self.cells.iter().enumerate().filter_map(move |(i, cell)| {
            let Behind { farthest, colour } = (*cell)?;
            let [u, v] = [i % self.columns, i / self.columns].map(|k| (k as f32 + 0.5) * side);
            let depth = 1.0 / (BEHIND * farthest);
            let mean = view.pinhole.unproject(Projected { u, v, depth });
            Some(row(mean, SIGMA_BLOCKS * side * depth / view.pinhole.fx, OPACITY, colour))
        })
    }
}

/// What is behind four blocks together; `None` where that differs.
fn joined(four: [Behind; 4], factor: f32) -> Option<Behind> {
    let farthest = four.iter().map(|block| block.farthest).fold(f32::INFINITY, f32::min);
    let mean = [0, 1, 2].map(|k| 0.25 * four.iter().map(|block| block.colour[k]).sum::<f32>());
    let alike = |block: &Behind| {
        let near = |k: usize| (block.colour[k] - mean[k]).abs() <= 0.5 * factor * SAME_COLOUR;
        block.farthest <= (1.0 + factor * SAME_DEPTH) * farthest && (0..3).all(near)
    };
    four.iter().all(alike).then_some(Behind { farthest, colour: mean })
}

fn of_block(view: &View, sheet: &Sheet, row_of_block: usize, column_of_block: usize) -> Option<Behind> {
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
    Some(Behind { farthest, colour: sum.map(|s: f32| s / count) })
}

#[cfg(test)]
mod tests {
    use super::{Sheet, Trust, rows};
    use crate::{
        gaussians::{Coarseness, LOG_SCALE, MEAN},
        views::samples::{ahead, seen},
    };

    #[test]
    fn blocks_behind_which_there_is_the_same_are_one() {
        let (width, height) = (240, 144);
        let wall = |edge: usize| {
            let near = |i: usize| i % width < edge;
            let view = seen(ahead(width, height, 50.0), vec![0.5; 3 * width * height]);
            let inverse_depths = (0..width * height).map(|i| if near(i) { 0.2 } else { 0.05 }).collect();
            (view, Sheet { inverse_depths, trust: vec![Trust::Confirmed; width * height] })
        };
        let count = |edge, factor| {
            let (view, sheet) = wall(edge);
            rows(&view, &sheet, Coarseness::new(factor).unwrap()).len()
        };
        // 40 x 24 blocks; of the twice as wide ones, and of those twice as wide again, all but the outermost.
        assert_eq!((count(0, 0.0), count(0, 1.0)), (960, (960 - 4 * 180) + (180 - 4 * 32) + 32));
        let with_edge = count(126, 1.0);
        assert!(with_edge > 324 && with_edge < 600, "{with_edge}");
        let (view, sheet) = wall(0);
        let all = rows(&view, &sheet, Coarseness::default());
        let wide = |side: f32| all.iter().filter(|row| (row[LOG_SCALE.start].exp() - 0.3 * side).abs() < 0.01).count();
        assert_eq!([wide(6.0), wide(12.0), wide(24.0)], [240, 52, 32]);
        assert!(all.iter().all(|row| (row[MEAN.start + 2] - 25.0).abs() < 1e-3));
    }
}
