//! The nearest site of every place near one, for lookups in the inner loops.

use super::{
    grid::{Grid, whole},
    sites::Sites,
};

const NONE: u32 = u32::MAX;

/// For every cell its nearest site, where one is near.
#[derive(Clone, Debug)]
pub(super) struct Field {
    grid: Grid,
    /// `[M, 2]` means of the sites of a sweep, metres.
    means: Vec<[f32; 2]>,
    /// `[cells]` index of the site whose mean is nearest to the cell's middle; `NONE` where none is near.
    nearest: Vec<u32>,
}

impl Field {
    /// That of the sites that `wanted` names, each seen up to `reach` metres away.
    pub(super) fn of(sites: &Sites, reach: f32, wanted: impl Fn(usize) -> bool) -> Self {
        let grid = sites.grid;
        let means: Vec<[f32; 2]> = sites.sites.iter().map(|site| [site.mean[0], site.mean[1]]).collect();
        let mut nearest = vec![NONE; grid.len()];
        let mut squares = vec![reach * reach; grid.len()];
        let cells = whole(reach / grid.cell);
        for ((index, label), &mean) in
            (0..means.len()).zip(0_u32..).zip(&means).filter(|&((index, _), _)| wanted(index))
        {
            let [x, y] = grid.to_first(mean);
            let [columns, rows] = grid.around_cell(sites.cells[index], cells);
            for row in rows {
                let b = y + row as f32 * grid.cell;
                for column in columns.clone() {
                    let a = x + column as f32 * grid.cell;
                    let (square, cell) = (a * a + b * b, row * grid.side + column);
                    if square < squares[cell] {
                        squares[cell] = square;
                        nearest[cell] = label;
                    }
                }
            }
        }
        Self { grid, means, nearest }
    }

    /// That of no site at all.
    pub(super) fn empty(grid: Grid) -> Self {
        Self { grid, means: Vec::new(), nearest: Vec::new() }
    }

    /// The nearest site, and how far it is.
    pub(super) fn nearest(&self, x: f32, y: f32) -> Found {
        let Some(cell) = self.grid.index(x, y) else { return Found::Outside };
        match self.nearest.get(cell) {
            None | Some(&NONE) => Found::Nothing,
            Some(&site) => {
                let [a, b] = self.means[site as usize];
                let (a, b) = (a - x, b - y);
                Found::Site { index: site as usize, square: a * a + b * b }
            }
        }
    }
}

/// What is near a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Found {
    /// The field does not reach there.
    Outside,
    /// Nothing.
    Nothing,
    /// A site.
    Site {
        /// Its index among those of its sweep.
        index: usize,
        /// Square of its distance, square metres.
        square: f32,
    },
}
