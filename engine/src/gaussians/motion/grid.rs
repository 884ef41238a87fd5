//! A square of cells around a sensor, seen from above.

use lgs_formats::casts::{to_f32, whole};

/// A square of cells around a sensor, seen from above. What lies outside has no cell, so memory is bounded.
///
/// Grids of one cell size share their borders, wherever they are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    /// Lowest corner, cells from the clip frame's origin.
    pub(super) first: [i64; 2],
    /// The same, metres.
    low: [f32; 2],
    /// Length of a cell's side, metres.
    pub(super) cell: f32,
    /// Cells along each side of the square.
    pub(super) side: usize,
}

impl Grid {
    /// The cells of `cell` metres that are at most `reach` metres from `centre` along either axis.
    pub(super) fn around(centre: [f32; 3], reach: f32, cell: f32) -> Self {
        let size = f64::from(cell);
        let first = [0, 1].map(|k| floor(f64::from(centre[k] - reach) / size));
        let low = first.map(|cells| to_f32(cells as f64 * size));
        Self { first, low, cell, side: whole(2.0 * reach / cell) + 1 }
    }

    /// Number of cells.
    pub(super) const fn len(&self) -> usize {
        self.side * self.side
    }

    /// Index of the cell that holds a point; `None` outside.
    pub(super) fn index(&self, x: f32, y: f32) -> Option<usize> {
        let [column, row] = [(x - self.low[0]) / self.cell, (y - self.low[1]) / self.cell];
        let inside = |cells: f32| cells >= 0.0 && cells < self.side as f32;
        (inside(column) && inside(row)).then(|| whole(row) * self.side + whole(column))
    }

    /// Columns and rows at most `reach` away from a cell.
    pub(super) fn around_cell(&self, index: usize, reach: usize) -> [std::ops::Range<usize>; 2] {
        [index % self.side, index / self.side].map(|at| at.saturating_sub(reach)..(at + reach + 1).min(self.side))
    }
}

/// Points by the cell that they are in.
#[derive(Clone, Debug)]
pub(super) struct Buckets {
    grid: Grid,
    /// `[cells + 1]` where the points of each cell begin.
    starts: Vec<u32>,
    /// Indices of the points, cell by cell, and where they are.
    points: Vec<(u32, [f32; 3])>,
}

impl Buckets {
    /// Those of points; points outside of the grid are left out.
    pub(super) fn of(grid: Grid, points: impl Iterator<Item = [f32; 3]> + Clone) -> Self {
        let cells = || points.clone().map(|[x, y, _]| grid.index(x, y));
        let mut starts = vec![0_u32; grid.len() + 1];
        cells().flatten().for_each(|cell| starts[cell + 1] += 1);
        for cell in 0..grid.len() {
            starts[cell + 1] += starts[cell];
        }
        let mut next = starts.clone();
        let mut sorted = vec![(0, [0.0; 3]); starts[grid.len()] as usize];
        for ((cell, index), point) in cells().zip(0_u32..).zip(points.clone()) {
            if let Some(cell) = cell {
                sorted[next[cell] as usize] = (index, point);
                next[cell] += 1;
            }
        }
        Self { grid, starts, points: sorted }
    }

    /// The points in all cells that a square of half width `reach` metres around a place touches; `None` outside of the grid.
    pub(super) fn around(&self, x: f32, y: f32, reach: f32) -> Option<impl Iterator<Item = (u32, [f32; 3])> + '_> {
        let cell = self.grid.index(x, y)?;
        let [columns, rows] = self.grid.around_cell(cell, whole((reach / self.grid.cell).ceil()));
        Some(rows.flat_map(move |row| {
            let [start, end] =
                [columns.start, columns.end].map(|column| self.starts[row * self.grid.side + column] as usize);
            self.points[start..end].iter().copied()
        }))
    }
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "coordinates are at most 1e6 m from their sensor, and saturate beyond what i64 holds"
)]
fn floor(value: f64) -> i64 {
    value.floor() as i64
}

#[cfg(test)]
mod tests {
    use super::Grid;

    #[test]
    fn every_point_has_the_cell_around_it_and_nothing_beyond_has_one() {
        let grid = Grid::around([1000.3, -2.0, 5.0], 8.0, 0.5);
        for (x, y) in [(1000.3, -2.0), (992.6, -9.9), (1008.0, 5.9)] {
            let cell = grid.index(x, y).unwrap();
            let middle = [0, 1].map(|k| grid.low[k] + ([cell % grid.side, cell / grid.side][k] as f32 + 0.5) * 0.5);
            assert!((middle[0] - x).abs() <= 0.2501 && (middle[1] - y).abs() <= 0.2501, "{x} {y}: {middle:?}");
        }
        for (x, y) in [(991.0, 0.0), (1000.0, 7.0), (f32::NAN, 0.0), (0.0, f32::INFINITY), (1e30, -1e30)] {
            assert_eq!(grid.index(x, y), None, "{x} {y}");
        }
        assert!(Grid::around([f32::MAX, f32::NAN, 0.0], 8.0, 0.5).len() < 2000);
    }

    #[test]
    fn grids_share_their_borders() {
        let [a, b] = [[0.0, 0.0, 0.0], [3.3, -7.9, 0.0]].map(|centre| Grid::around(centre, 20.0, 1.0));
        let [i, j] = [a.index(4.4, 5.5).unwrap(), b.index(4.4, 5.5).unwrap()];
        let cell = |grid: &Grid, index: usize| {
            (grid.first[0] + (index % grid.side) as i64, grid.first[1] + (index / grid.side) as i64)
        };
        assert_eq!(cell(&a, i), cell(&b, j));
    }
}
