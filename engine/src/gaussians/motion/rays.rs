//! Where a sweep looked: the nearest return in each direction.

use super::grid::whole;

/// Columns of directions around the sensor; 0.3 to 0.6 degrees each.
const COLUMNS: usize = 720;
/// Rows of directions from the lowest on.
const ROWS: usize = 80;
/// Slope of the lowest row, metres a metre.
const LOWEST: f32 = -0.7;
/// Slope between two rows, metres a metre.
const ROW: f32 = 0.014;
/// How much farther a return must be than a point that it shows to be empty: metres, and share of the distance.
const BEYOND: [f32; 2] = [0.5, 0.01];

/// The nearest returns of a sweep by direction.
#[derive(Clone, Debug)]
pub(super) struct Rays {
    origin: [f32; 3],
    /// `[ROWS, COLUMNS]` metres; infinite where nothing came back.
    ranges: Vec<f32>,
}

impl Rays {
    /// Those of a sweep that was taken from `origin`.
    pub(super) fn of(points: &[[f32; 3]], origin: [f32; 3]) -> Self {
        let mut rays = Self { origin, ranges: vec![f32::INFINITY; ROWS * COLUMNS] };
        for &point in points {
            if let Some(Direction { column, row, range }) = rays.direction(point) {
                let nearest = &mut rays.ranges[row * COLUMNS + column];
                *nearest = nearest.min(range);
            }
        }
        rays
    }

    /// Whether the sweep saw through a point: returns came back around its direction, all of them from farther away.
    pub(super) fn through(&self, point: [f32; 3]) -> bool {
        let Some(Direction { column, row, range }) = self.direction(point) else { return false };
        let farther = range + BEYOND[0] + BEYOND[1] * range;
        let mut seen = false;
        for r in row.saturating_sub(1)..(row + 2).min(ROWS) {
            for c in [column + COLUMNS - 1, column, column + 1] {
                let found = self.ranges[r * COLUMNS + c % COLUMNS];
                if found < farther {
                    return false;
                }
                seen |= found.is_finite();
            }
        }
        seen
    }

    fn direction(&self, point: [f32; 3]) -> Option<Direction> {
        let [x, y, z] = std::array::from_fn(|k| point[k] - self.origin[k]);
        let flat = (x * x + y * y).sqrt();
        let row = (z / flat - LOWEST) / ROW;
        // Grows with the angle as atan2 does, from 0 to 4, for much less.
        let across = y / (x.abs() + y.abs());
        let turn = if x < 0.0 { 3.0 - across } else { 1.0 + across };
        (flat > 0.0 && row >= 0.0 && row < ROWS as f32).then(|| Direction {
            column: whole(turn * (COLUMNS / 4) as f32) % COLUMNS,
            row: whole(row),
            range: (flat * flat + z * z).sqrt(),
        })
    }
}

/// Where a point is, seen from the sensor.
struct Direction {
    column: usize,
    row: usize,
    range: f32,
}

#[cfg(test)]
mod tests {
    use super::Rays;

    #[test]
    fn a_wall_hides_what_is_behind_and_shows_that_nothing_is_before() {
        let wall: Vec<[f32; 3]> = (0..400_u16).map(|i| [20.0, f32::from(i) * 0.05 - 10.0, 1.0]).collect();
        let rays = Rays::of(&wall, [0.0, 0.0, 1.0]);
        assert!(rays.through([10.0, 0.0, 1.0]), "before");
        assert!(!rays.through([19.8, 0.0, 1.0]), "at");
        assert!(!rays.through([25.0, 0.0, 1.0]), "behind");
        assert!(!rays.through([-10.0, 0.0, 1.0]) && !rays.through([10.0, 0.0, 9.0]), "where nothing came back");
        assert!(!rays.through([0.0, 0.0, 1.0]) && !rays.through([f32::MAX, 0.0, 0.0]));
    }
}
