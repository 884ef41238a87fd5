//! Whether something is near a place, for lookups in the innermost loop.

use lgs_formats::casts::whole;

use super::{
    grid::Grid,
    sites::{CELL, REACH, Site},
};

/// Cells around a site in which it is near.
const AROUND: usize = 2;
/// Height of a level, metres.
const LEVEL: f32 = 0.5;
/// Levels above each other, and how many of them are below the sensor.
const LEVELS: [usize; 2] = [64, 32];

/// The places that are near some sites.
#[derive(Clone, Debug)]
pub(super) struct Mask {
    grid: Grid,
    /// Height of the lowest level, metres.
    low: f32,
    /// `[cells]` a bit for each level.
    levels: Vec<u64>,
}

impl Mask {
    /// Those at most half a metre from the sites that are `wanted`, of a sweep that was taken from `origin`.
    pub(super) fn of(sites: &[Site], origin: [f32; 3], wanted: impl Fn(usize) -> bool) -> Self {
        let grid = Grid::around(origin, REACH, CELL);
        let mut mask = Self { grid, low: origin[2] - LEVELS[1] as f32 * LEVEL, levels: vec![0; grid.len()] };
        for (_, site) in sites.iter().enumerate().filter(|(index, _)| wanted(*index)) {
            let [x, y, z] = site.mean;
            let Some((cell, level)) = grid.index(x, y).zip(mask.level(z)) else { continue };
            let bits = (7_u64 << level) >> 1;
            let [columns, rows] = grid.around_cell(cell, AROUND);
            for row in rows {
                mask.levels[row * grid.side + columns.start..row * grid.side + columns.end]
                    .iter_mut()
                    .for_each(|levels| *levels |= bits);
            }
        }
        mask
    }

    /// Whether one of them is near.
    pub(super) fn near(&self, [x, y, z]: [f32; 3]) -> bool {
        let place = self.grid.index(x, y).zip(self.level(z));
        place.is_some_and(|(cell, level)| self.levels[cell] >> level & 1 == 1)
    }

    fn level(&self, z: f32) -> Option<usize> {
        let level = (z - self.low) / LEVEL;
        (level >= 0.0 && level < LEVELS[0] as f32).then(|| whole(level))
    }
}
