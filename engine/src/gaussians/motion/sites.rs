//! What stands above the ground, gathered in small cells and in clusters of them.

use super::{
    grid::{Grid, whole},
    ground::Ground,
};

/// Side of the cell of a site, metres.
pub(super) const CELL: f32 = 0.2;
/// Distance from the sensor up to which there are sites, metres.
pub(super) const REACH: f32 = 80.0;
/// Heights above the ground between which returns make sites, metres.
const HEIGHTS: std::ops::Range<f32> = 0.28..3.2;
/// Cells between two sites of one cluster, next to the sensor.
const GAP: usize = 2;
/// Distance over which the gap grows by a cell, metres: far away returns are sparse.
const GAP_GROWS: f32 = 12.0;
/// Largest gap, cells.
const MAX_GAP: usize = 6;
/// Fewest returns of a cluster.
const MIN_RETURNS: usize = 5;
/// Longest diagonal of the cluster of a thing that can move, metres.
const MAX_SIZE: f32 = 14.0;

/// The returns above one cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Site {
    /// Their mean, metres, clip frame.
    pub(super) mean: [f32; 3],
    /// How many they are.
    pub(super) returns: usize,
    /// Index of the cluster; `None` where it is too small or too large to be of something that moves.
    pub(super) cluster: Option<usize>,
    /// Its distance from the sensor seen from above, metres.
    pub(super) range: f32,
}

/// Returns of one cell that are gathered.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    coordinates: [f64; 3],
    returns: usize,
}

impl Sum {
    fn add(&mut self, point: [f32; 3]) {
        self.returns += 1;
        self.coordinates = std::array::from_fn(|k| self.coordinates[k] + f64::from(point[k]));
    }

    fn site(&self, origin: [f32; 3]) -> Site {
        let mean = self.coordinates.map(|sum| crate::views::to_f32(sum / self.returns.max(1) as f64));
        let [x, y] = [mean[0] - origin[0], mean[1] - origin[1]];
        Site { mean, returns: self.returns, cluster: None, range: (x * x + y * y).sqrt() }
    }
}

/// Sites of one sweep that belong together.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Cluster {
    /// Indices of its sites, rising.
    pub(super) sites: Vec<usize>,
    /// Lowest and highest coordinates of their means, metres.
    low: [f32; 2],
    high: [f32; 2],
}

impl Cluster {
    fn of(sites: &[Site], members: Vec<usize>) -> Self {
        let along = |start: f32, pick: fn(f32, f32) -> f32| {
            [0, 1].map(|k| members.iter().map(|&site| sites[site].mean[k]).fold(start, pick))
        };
        Self { low: along(f32::MAX, f32::min), high: along(f32::MIN, f32::max), sites: members }
    }

    /// Distance of the rectangles around two clusters, metres.
    pub(super) fn distance(&self, other: &Self) -> f32 {
        let [x, y] = [0, 1].map(|k| (other.low[k] - self.high[k]).max(self.low[k] - other.high[k]).max(0.0));
        (x * x + y * y).sqrt()
    }
}

/// The sites of a sweep.
#[derive(Clone, Debug)]
pub(super) struct Sites {
    pub(super) grid: Grid,
    /// In the order of their cells.
    pub(super) sites: Vec<Site>,
    pub(super) clusters: Vec<Cluster>,
    /// `[sites]` their cells.
    pub(super) cells: Vec<usize>,
    /// `[cells]` site of each cell; `NONE` where there is none.
    of_cell: Vec<u32>,
}

const NONE: u32 = u32::MAX;

impl Sites {
    /// Those of the returns of a sweep that was taken from `origin`.
    pub(super) fn of(points: &[[f32; 3]], origin: [f32; 3], ground: &Ground) -> Self {
        let grid = Grid::around(origin, REACH, CELL);
        let stands = |point: [f32; 3]| ground.above(point).is_some_and(|h| HEIGHTS.contains(&h));
        let cell =
            |&point: &[f32; 3]| grid.index(point[0], point[1]).filter(|_| stands(point)).map(|cell| (cell, point));
        let returns: Vec<(usize, [f32; 3])> = points.iter().filter_map(cell).collect();
        let mut of_cell = vec![NONE; grid.len()];
        returns.iter().for_each(|&(cell, _)| of_cell[cell] = 0);
        let taken = |cell: &usize| of_cell[*cell] != NONE;
        let cells: Vec<usize> = (0..grid.len()).filter(taken).collect();
        for (site, &cell) in (0..NONE).zip(&cells) {
            of_cell[cell] = site;
        }
        let mut sums = vec![Sum::default(); cells.len()];
        for &(cell, point) in &returns {
            sums[of_cell[cell] as usize].add(point);
        }
        let sites = sums.iter().map(|sum| sum.site(origin)).collect();
        let mut made = Self { grid, sites, clusters: Vec::new(), cells, of_cell };
        made.clusters = made.clustered();
        for (index, cluster) in made.clusters.iter().enumerate() {
            for &site in &cluster.sites {
                made.sites[site].cluster = Some(index);
            }
        }
        made
    }

    /// The site that holds a point, whatever its height.
    pub(super) fn at(&self, x: f32, y: f32) -> Option<usize> {
        let site = self.of_cell[self.grid.index(x, y)?];
        (site != NONE).then_some(site as usize)
    }

    /// The clusters of a size that can move, by their first site.
    fn clustered(&self) -> Vec<Cluster> {
        let mut parents: Vec<usize> = (0..self.cells.len()).collect();
        for (site, &cell) in self.cells.iter().enumerate() {
            let gap = (GAP + whole(self.sites[site].range / GAP_GROWS)).min(MAX_GAP);
            let [columns, rows] = self.grid.around_cell(cell, gap);
            for row in rows {
                for &other in &self.of_cell[row * self.grid.side + columns.start..row * self.grid.side + columns.end] {
                    if other != NONE {
                        join(&mut parents, site, other as usize);
                    }
                }
            }
        }
        let mut members: Vec<Vec<usize>> = vec![Vec::new(); parents.len()];
        for site in 0..parents.len() {
            members[root(&mut parents, site)].push(site);
        }
        let clusters = members.into_iter().filter(|sites| !sites.is_empty());
        clusters.map(|sites| Cluster::of(&self.sites, sites)).filter(|cluster| self.can_move(cluster)).collect()
    }

    fn can_move(&self, cluster: &Cluster) -> bool {
        let returns: usize = cluster.sites.iter().map(|&site| self.sites[site].returns).sum();
        let [x, y] = [0, 1].map(|k| cluster.high[k] - cluster.low[k]);
        returns >= MIN_RETURNS && x * x + y * y <= MAX_SIZE * MAX_SIZE
    }
}

fn root(parents: &mut [usize], mut index: usize) -> usize {
    while parents[index] != index {
        parents[index] = parents[parents[index]];
        index = parents[index];
    }
    index
}

/// Nothing: the lower root becomes that of both.
fn join(parents: &mut [usize], a: usize, b: usize) {
    let [a, b] = [root(parents, a), root(parents, b)];
    parents[a.max(b)] = a.min(b);
}
