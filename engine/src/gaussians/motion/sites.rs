//! What stands above the ground, gathered in small cubes.

use lgs_formats::casts::whole;

use super::{
    grid::{Buckets, Grid},
    ground::Ground,
};

/// Side of a cube, metres: as far as neighbouring beams are apart at 40 m.
pub(super) const CELL: f32 = 0.25;
/// Distance from the sensor up to which there are sites, metres.
pub(super) const REACH: f32 = 80.0;
/// Heights above the ground between which returns make sites, metres: kerbs are lower, bridges and branches over the road higher.
pub(super) const HEIGHTS: std::ops::Range<f32> = 0.28..4.6;
/// Cubes above each other.
const LEVELS: usize = 256;

/// No site.
pub(super) const NONE: u32 = u32::MAX;

/// The returns in one cube.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Site {
    /// Their mean, metres, clip frame.
    pub(super) mean: [f32; 3],
    /// The mean of their times, seconds.
    pub(super) time: f32,
    /// How many they are.
    pub(super) returns: u32,
    /// Distance from the sensor seen from above, metres.
    pub(super) range: f32,
}

/// The sites of a sweep.
#[derive(Clone, Debug)]
pub(super) struct Sites {
    /// In the order of their cubes.
    pub(super) sites: Vec<Site>,
    /// `[returns]` site of each return of the sweep; `NONE` for those on the ground, too high and too far.
    pub(super) of_return: Vec<u32>,
    /// The sites by where they are.
    pub(super) buckets: Buckets,
}

impl Sites {
    /// Those of the returns of a sweep that was taken from `origin`.
    ///
    /// # Shapes
    /// `points` and `times` `[returns]`.
    pub(super) fn of(points: &[[f32; 3]], times: &[f32], origin: [f32; 3], ground: &Ground) -> Self {
        let grid = Grid::around(origin, REACH, CELL);
        let stands = |point: [f32; 3]| ground.above(point).is_some_and(|h| HEIGHTS.contains(&h));
        let key = |(&point, index): (&[f32; 3], u32)| {
            let cell = grid.index(point[0], point[1]).filter(|_| stands(point))?;
            let level = (point[2] - origin[2]) / CELL + 0.5 * LEVELS as f32;
            (level >= 0.0 && level < LEVELS as f32).then(|| (cell * LEVELS + whole(level), index))
        };
        let mut keyed: Vec<(usize, u32)> = points.iter().zip(0_u32..).filter_map(key).collect();
        keyed.sort_unstable();
        let mut sites = Vec::new();
        let mut of_return = vec![NONE; points.len()];
        for (group, label) in keyed.chunk_by(|a, b| a.0 == b.0).zip(0_u32..) {
            let mut sum = [0.0_f64; 4];
            for &(_, index) in group {
                of_return[index as usize] = label;
                let [x, y, z] = points[index as usize];
                let values = [x, y, z, times[index as usize]];
                sum = std::array::from_fn(|k| sum[k] + f64::from(values[k]));
            }
            let [x, y, z, time] = sum.map(|sum| lgs_formats::casts::to_f32(sum / group.len() as f64));
            let range = ((x - origin[0]).powi(2) + (y - origin[1]).powi(2)).sqrt();
            sites.push(Site { mean: [x, y, z], time, returns: u32::try_from(group.len()).unwrap_or(u32::MAX), range });
        }
        let buckets = Buckets::of(Grid::around(origin, REACH, 2.0 * CELL), sites.iter().map(|site| site.mean));
        Self { sites, of_return, buckets }
    }

    /// Number of sites.
    pub(super) fn len(&self) -> usize {
        self.sites.len()
    }
}
