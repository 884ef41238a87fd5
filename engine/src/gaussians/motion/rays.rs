//! Where a sweep looked: the nearest return in each direction.
use lgs_formats::casts::whole;

/// Columns of directions around the sensor; 0.2 to 0.3 degrees each.
const COLUMNS: usize = 1440;
/// Rows of directions from the lowest on.
const ROWS: usize = 320;
/// Slope of the lowest row, metres a metre.
const LOWEST: f32 = -0.7;
/// Slope between two rows, metres a metre.
const ROW: f32 = 0.0035;
/// Half heights of the windows in which beams near a direction are looked for, rows: sensors have 16 to 128 beams above each other.
const WINDOWS: [usize; 3] = [1, 3, 5];
/// How far beside a direction a beam is looked for, columns. There must be one on either side: along a wall seen at a grazing angle, those on one
/// side are all farther.
const BESIDE: usize = 4;
/// How much farther a return must be than a point that it shows to be empty: metres, and share of the distance.
const BEYOND: [f32; 2] = [0.35, 0.015];

/// What a sweep saw where a point would be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Look {
    /// Through it: returns came back around its direction, all of them from farther away.
    Through,
    /// Something before it: all returns around its direction are nearer.
    Hidden,
    /// A surface near it, or an edge, or nothing at all.
    Unknown,
}

/// The nearest returns of a sweep by direction.
#[derive(Clone, Debug)]
pub(super) struct Rays {
    origin: [f32; 3],
    /// `[COLUMNS]` where the sensor was when it looked there.
    origins: Vec<[f32; 3]>,
    /// `[ROWS, COLUMNS]` metres; infinite where nothing came back.
    ranges: Vec<f32>,
}

impl Rays {
    /// Those of a sweep that was taken from about `origin`; each return from `origins`.
    pub(super) fn of(points: &[[f32; 3]], origins: &[[f32; 3]], origin: [f32; 3]) -> Self {
        let mut ranges = vec![f32::INFINITY; ROWS * COLUMNS];
        let mut sums = vec![([0.0_f64; 3], 0_u32); COLUMNS];
        for (&point, &from) in points.iter().zip(origins) {
            if let Some(Direction { column, row, range }) = direction(from, point) {
                let nearest = &mut ranges[row * COLUMNS + column];
                *nearest = nearest.min(range);
                let (sum, count) = &mut sums[column];
                *sum = std::array::from_fn(|k| sum[k] + f64::from(from[k]));
                *count += 1;
            }
        }
        let mean = |&(sum, count): &([f64; 3], u32)| {
            if count == 0 { origin } else { sum.map(|sum| lgs_formats::casts::to_f32(sum / f64::from(count))) }
        };
        Self { origin, origins: sums.iter().map(mean).collect(), ranges }
    }

    fn direction(&self, point: [f32; 3]) -> Option<Direction> {
        let roughly = direction(self.origin, point)?;
        direction(self.origins[roughly.column], point)
    }

    /// What the sweep saw where a point would be.
    pub(super) fn look(&self, point: [f32; 3]) -> Look {
        let Some(Direction { column, row, range }) = self.direction(point) else { return Look::Unknown };
        let margin = BEYOND[0].max(BEYOND[1] * range);
        for window in WINDOWS {
            let mut around = Around { nearest: f32::INFINITY, farthest: 0.0, sides: 0 };
            for r in row.saturating_sub(window)..(row + window + 1).min(ROWS) {
                let line = &self.ranges[r * COLUMNS..(r + 1) * COLUMNS];
                around.add(0, line[column]);
                let beside = |step: usize| {
                    let found =
                        (1..=BESIDE).map(|k| line[(column + k * step) % COLUMNS]).find(|range| range.is_finite());
                    found.unwrap_or(f32::INFINITY)
                };
                around.add(1, beside(1));
                around.add(2, beside(COLUMNS - 1));
            }
            if around.sides == 3 {
                return match () {
                    () if around.nearest >= range + margin => Look::Through,
                    () if around.farthest <= range - margin => Look::Hidden,
                    () => Look::Unknown,
                };
            }
        }
        Look::Unknown
    }
}

fn direction(origin: [f32; 3], point: [f32; 3]) -> Option<Direction> {
    let [x, y, z]: [f32; 3] = std::array::from_fn(|k| point[k] - origin[k]);
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

/// The beams around a direction.
struct Around {
    nearest: f32,
    farthest: f32,
    /// Bits of the sides on which there are some.
    sides: u8,
}

impl Around {
    fn add(&mut self, sides: u8, range: f32) {
        if range.is_finite() {
            self.nearest = self.nearest.min(range);
            self.farthest = self.farthest.max(range);
            self.sides |= sides;
        }
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
    use super::{Look, Rays};

    #[test]
    fn a_wall_hides_what_is_behind_and_shows_that_nothing_is_before() {
        let wall: Vec<[f32; 3]> = (0..400_u16).map(|i| [20.0, f32::from(i) * 0.05 - 10.0, 1.0]).collect();
        let rays = Rays::of(&wall, &vec![[0.0, 0.0, 1.0]; wall.len()], [0.0, 0.0, 1.0]);
        assert!(rays.look([10.0, 0.0, 1.0]) == Look::Through, "before");
        assert_eq!(rays.look([19.8, 0.0, 1.0]), Look::Unknown, "at");
        assert_eq!(rays.look([25.0, 0.0, 1.0]), Look::Hidden, "behind");
        for nothing in [[-10.0, 0.0, 1.0], [10.0, 0.0, 9.0], [0.0, 0.0, 1.0], [f32::MAX, 0.0, 0.0]] {
            assert_eq!(rays.look(nothing), Look::Unknown, "where nothing came back");
        }
    }
}
