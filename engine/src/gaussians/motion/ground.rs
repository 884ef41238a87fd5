//! How high the ground is, cell by cell.

use super::grid::Grid;

/// Side of a cell, metres.
const CELL: f32 = 1.0;
/// How many of a cell's lowest returns are kept.
const KEPT: usize = 10;
/// Of its returns, from below, the third is the ground, and of many one in so many: what is below it may be mirrored or noise.
const RANK: (usize, usize) = (3, 15);
/// How far a lower cell makes the ground beside it known, cells.
const CONE_REACH: usize = 3;
/// How far below a quarter of the cells around it a cell is no ground, metres, and how far away these are, cells.
const PIT: f32 = 1.0;
const PIT_REACH: usize = 3;
/// Slope that the ground may have, metres a metre.
const SLOPE: f32 = 0.12;
/// Rounds in which cells without returns take their ground from their neighbours.
const FILL_ROUNDS: usize = 8;

/// The lowest returns of every cell around a sensor.
#[derive(Clone, Debug)]
pub(super) struct Lowest {
    grid: Grid,
    /// `[cells, 10]` metres, rising; infinite where there are fewer.
    heights: Vec<[f32; KEPT]>,
    /// `[cells]` how many returns there are.
    counts: Vec<usize>,
}

impl Lowest {
    /// Those of a sweep, at most `reach` metres from `centre`.
    pub(super) fn of(points: &[[f32; 3]], centre: [f32; 3], reach: f32) -> Self {
        let grid = Grid::around(centre, reach, CELL);
        let mut heights = vec![[f32::INFINITY; KEPT]; grid.len()];
        let mut counts = vec![0; grid.len()];
        for &[x, y, z] in points {
            if let Some(index) = grid.index(x, y) {
                insert(&mut heights[index], z);
                counts[index] += 1;
            }
        }
        Self { grid, heights, counts }
    }

    /// Takes in what another sweep knows of the same cells.
    fn add(&mut self, other: &Self) {
        let shift = [0, 1].map(|k| self.grid.first[k].saturating_sub(other.grid.first[k]));
        for (index, heights) in self.heights.iter_mut().enumerate() {
            let here = [index % self.grid.side, index / self.grid.side];
            let there = [0, 1].map(|k| shift[k].saturating_add(here[k] as i64));
            if let [Ok(column), Ok(row)] = there.map(usize::try_from)
                && column.max(row) < other.grid.side
            {
                let there = row * other.grid.side + column;
                other.heights[there].iter().for_each(|&z| insert(heights, z));
                self.counts[index] += other.counts[there];
            }
        }
    }
}

/// Heights of the ground around a sensor.
#[derive(Clone, Debug)]
pub(super) struct Ground {
    grid: Grid,
    /// `[cells]` metres; infinite where nothing is known.
    heights: Vec<f32>,
}

impl Ground {
    /// The ground of a sweep and of others near to it: the third lowest return of a cell, or of many a higher one, unless a cell near by says that it is lower than
    /// a slope of 12 % allows.
    pub(super) fn of<'a>(own: &Lowest, others: impl Iterator<Item = &'a Lowest>) -> Self {
        let mut all = own.clone();
        others.for_each(|other| all.add(other));
        let grid = all.grid;
        let rank = |count: usize| (count / RANK.1).clamp(RANK.0, KEPT) - 1;
        let low: Vec<f32> = all.heights.iter().zip(&all.counts).map(|(low, &count)| low[rank(count)]).collect();
        let low = without_pits(&grid, &low);
        let mut heights = cones(&grid, &low, CONE_REACH, |_| true);
        for _ in 0..FILL_ROUNDS {
            heights = cones(&grid, &heights, 1, |height| height == f32::INFINITY);
        }
        Self { grid, heights }
    }

    /// Height of a point above the ground, metres; `None` where the ground is not known.
    pub(super) fn above(&self, point: [f32; 3]) -> Option<f32> {
        let height = self.heights[self.grid.index(point[0], point[1])?];
        height.is_finite().then_some(point[2] - height)
    }
}

/// Puts a value into its place among the lowest.
fn insert(lowest: &mut [f32; KEPT], value: f32) {
    if value >= lowest[KEPT - 1] {
        return;
    }
    let mut value = value;
    for place in lowest {
        if value < *place {
            std::mem::swap(&mut value, place);
        }
    }
}

/// The heights of cells, unknown where they are far below those around: mirrors and wet roads show things under the ground.
fn without_pits(grid: &Grid, heights: &[f32]) -> Vec<f32> {
    let mut around = Vec::new();
    let raised = |(cell, &own): (usize, &f32)| {
        if own == f32::INFINITY {
            return own;
        }
        let [columns, rows] = grid.around_cell(cell, PIT_REACH);
        around.clear();
        for row in rows {
            let line = &heights[row * grid.side + columns.start..row * grid.side + columns.end];
            around.extend(line.iter().copied().filter(|height| height.is_finite()));
        }
        around.sort_by(f32::total_cmp);
        if own < around[around.len() / 4] - PIT { f32::INFINITY } else { own }
    };
    heights.iter().enumerate().map(raised).collect()
}

/// The heights of all cells, those that are `wanted` lowered to what cells at most `reach` columns and rows away allow.
fn cones(grid: &Grid, heights: &[f32], reach: usize, wanted: impl Fn(f32) -> bool) -> Vec<f32> {
    let rise = |a: usize, b: usize| {
        let [x, y] = [a, b].map(|cells| cells as f32 * grid.cell);
        SLOPE * (x * x + y * y).sqrt()
    };
    let side = reach + 1;
    let rises: Vec<f32> = (0..side * side).map(|at| rise(at % side, at / side)).collect();
    let lowered = |(cell, &own): (usize, &f32)| {
        if !wanted(own) {
            return own;
        }
        let (column, row) = (cell % grid.side, cell / grid.side);
        let [columns, rows] = grid.around_cell(cell, reach);
        let mut lowest = own;
        for r in rows {
            for c in columns.clone() {
                lowest = lowest.min(heights[r * grid.side + c] + rises[r.abs_diff(row) * side + c.abs_diff(column)]);
            }
        }
        lowest
    };
    heights.iter().enumerate().map(lowered).collect()
}

#[cfg(test)]
mod tests {
    use super::{Ground, Lowest};

    #[test]
    fn a_car_stands_on_the_road_and_not_on_itself() {
        let mut points = Vec::new();
        for i in 0..200_u16 {
            for j in 0..200_u16 {
                let (x, y) = (f32::from(i) * 0.2 - 20.0, f32::from(j) * 0.2 - 20.0);
                let car = (4.0..8.0).contains(&x) && (-1.0..1.0).contains(&y);
                points.push([x, y, 0.05 * x - 1.8 + if car { 1.4 } else { 0.0 }]);
            }
        }
        let (here, there) = points.split_at(20_000);
        let lowest = |points: &[[f32; 3]], x: f32| Lowest::of(points, [x, 0.0, 0.0], 40.0);
        let ground = Ground::of(&lowest(here, 0.0), [lowest(there, 3.0)].iter());
        let road = ground.above([-7.3, 5.0, -1.8 - 0.05 * 7.3]).unwrap();
        assert!(road.abs() < 0.12, "{road}");
        let roof = ground.above([6.0, 0.0, 0.3 - 1.8 + 1.4]).unwrap();
        assert!((roof - 1.4).abs() < 0.25, "{roof}");
        assert_eq!(ground.above([500.0, 0.0, 0.0]), None);
        assert_eq!(ground.above([39.0, 39.0, 0.0]), None, "nobody looked there");
    }
}
