//! The ground around the sensors, as a plane.

use crate::points::PointCloud;

/// Half width of the square around the clip frame's origin in which the plane is fitted, cells of 1 m.
const REACH: usize = 25;
/// Fewest returns that a cell needs to say where its ground is.
const MIN_RETURNS: usize = 5;
/// Fewest cells that make a plane.
const MIN_CELLS: usize = 20;
/// Which of a cell's returns, by height, counts as its ground.
const LOW_SHARE: usize = 10;
/// Distance at which a cell has half its weight, metres.
const NEAR: f64 = 10.0;
/// Residuals at which a cell loses its weight, metres, one for each round of the fit.
const TOLERANCES: [f64; 4] = [0.5, 0.5, 0.15, 0.15];
/// Rounds with each tolerance.
const ROUNDS: usize = 5;

/// The plane `z = slope[0] x + slope[1] y + height` of the clip frame, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ground {
    slope: [f32; 2],
    height: f32,
}

impl Ground {
    /// The plane that most low returns around the origin lie on; `None` when there are too few.
    ///
    /// # Formula
    /// Iteratively reweighted least squares over the low returns of cells of 1 m, weight
    /// `1 / (1 + (d / 10 m)^2) / (1 + (r / tolerance)^2)^2` at distance d and residual r.
    pub(super) fn fit(cloud: &PointCloud) -> Option<Self> {
        let cells = low_points(cloud);
        if cells.len() < MIN_CELLS {
            return None;
        }
        let mut heights: Vec<f64> = cells.iter().map(|cell| cell[2]).collect();
        heights.sort_by(f64::total_cmp);
        let mut plane = [0.0, 0.0, heights[heights.len() / 4]];
        for tolerance in TOLERANCES {
            for _ in 0..ROUNDS {
                plane = solve(weighted_normal_equations(&cells, plane, tolerance));
            }
        }
        let [a, b, c] = plane.map(lgs_formats::casts::to_f32);
        let plane = Self { slope: [a, b], height: c };
        [a, b, c].iter().all(|v| v.is_finite()).then_some(plane)
    }

    /// Inverse depth (1 / metres) at which the ray `centre + depth * direction` meets the plane moved down by `lowered`
    /// metres; 0 when it never does.
    pub(super) fn inverse_depth(&self, centre: [f32; 3], direction: [f32; 3], lowered: f32) -> f32 {
        let above = |p: [f32; 3]| p[2] - self.slope[0] * p[0] - self.slope[1] * p[1];
        let height = above(centre) - self.height + lowered;
        if height <= 0.0 { 0.0 } else { (-above(direction) / height).max(0.0) }
    }
}

/// Centre and low height of every cell that has enough returns, metres.
fn low_points(cloud: &PointCloud) -> Vec<[f64; 3]> {
    let size = 2 * REACH;
    let mut cells: Vec<Vec<f32>> = vec![Vec::new(); size * size];
    for &[x, y, z] in &cloud.positions {
        if let Some((column, row)) = cell(x).zip(cell(y)) {
            cells[row * size + column].push(z);
        }
    }
    let centre = |index: usize| index as f64 - REACH as f64 + 0.5;
    let mut low = Vec::new();
    for (i, heights) in cells.iter_mut().enumerate().filter(|(_, heights)| heights.len() >= MIN_RETURNS) {
        heights.sort_by(f32::total_cmp);
        low.push([centre(i % size), centre(i / size), f64::from(heights[heights.len() / LOW_SHARE])]);
    }
    low
}

/// The row or column of cells that a coordinate falls into.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to lie inside the square before")]
fn cell(coordinate: f32) -> Option<usize> {
    let shifted = coordinate + REACH as f32;
    (shifted >= 0.0 && shifted < 2.0 * REACH as f32).then_some(shifted as usize)
}

/// `A^T W A | A^T W z` of the plane through the cells.
fn weighted_normal_equations(cells: &[[f64; 3]], plane: [f64; 3], tolerance: f64) -> [[f64; 4]; 3] {
    let mut system = [[0.0; 4]; 3];
    for &[x, y, z] in cells {
        let residual = (z - plane[0] * x - plane[1] * y - plane[2]) / tolerance;
        let weight = 1.0 / (1.0 + (x * x + y * y) / (NEAR * NEAR)) / (1.0 + residual * residual).powi(2);
        for (row, u) in system.iter_mut().zip([x, y, 1.0]) {
            for (entry, v) in row.iter_mut().zip([x, y, 1.0, z]) {
                *entry += weight * u * v;
            }
        }
    }
    system
}

/// The solution of a symmetric 3 x 3 system with its right-hand side in the last column, by elimination; a small ridge
/// keeps it finite.
fn solve(mut system: [[f64; 4]; 3]) -> [f64; 3] {
    for (i, row) in system.iter_mut().enumerate() {
        row[i] += 1e-6;
    }
    for i in 0..3 {
        let pivot = system[i];
        for (_, row) in system.iter_mut().enumerate().filter(|&(k, _)| k != i) {
            let share = row[i] / pivot[i];
            for (entry, p) in row.iter_mut().zip(pivot) {
                *entry -= share * p;
            }
        }
    }
    std::array::from_fn(|i| system[i][3] / system[i][i])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tilted road with a wall on one side of it.
    fn cloud() -> PointCloud {
        let mut cloud = PointCloud::default();
        for i in 0..60_u16 {
            for j in 0..60_u16 {
                let (x, y) = (f32::from(i) * 0.5 - 15.0, f32::from(j) * 0.5 - 15.0);
                let wall = if i > 52 { 3.0 } else { 0.0 };
                cloud.positions.extend([[x, y, 0.02 * x - 1.7 + wall]; 2]);
            }
        }
        cloud
    }

    #[test]
    fn the_plane_is_that_of_the_road() {
        let ground = Ground::fit(&cloud()).unwrap();
        assert!((ground.slope[0] - 0.02).abs() < 2e-3 && ground.slope[1].abs() < 2e-3, "{ground:?}");
        assert!((ground.height + 1.7).abs() < 0.03, "{ground:?}");
    }

    #[test]
    fn a_ray_meets_it_where_geometry_says() {
        let ground = Ground { slope: [0.0, 0.0], height: -2.0 };
        assert!((ground.inverse_depth([0.0; 3], [1.0, 0.0, -0.5], 0.0) - 0.25).abs() < 1e-6);
        assert!((ground.inverse_depth([0.0; 3], [1.0, 0.0, -0.5], 2.0) - 0.125).abs() < 1e-6);
        assert_eq!(ground.inverse_depth([0.0; 3], [1.0, 0.0, 0.5], 0.0), 0.0, "looks up");
        assert_eq!(ground.inverse_depth([0.0, 0.0, -3.0], [1.0, 0.0, -0.5], 0.0), 0.0, "is below");
    }

    #[test]
    fn a_few_returns_make_no_ground() {
        assert_eq!(Ground::fit(&PointCloud { positions: vec![[1.0; 3]; 9], ..PointCloud::default() }), None);
    }
}
