//! Which pixels of a tile a Gaussian can reach, all rows at once.

use std::ops::Range;

use pulp::Simd;

use super::constants::{LOG2_ALPHA_MIN, TILE_HEIGHT, TILE_WIDTH};
use super::project::Footprint;

/// One row of a Gaussian inside a tile.
#[derive(Clone, Copy, Debug)]
pub(super) struct RowSpan {
    /// x at which the row's alpha is largest, relative to the tile's left edge, pixels.
    pub(super) peak_x: f32,
    /// Exponent at the peak, base 2.
    pub(super) peak_log2: f32,
    /// Height above the mean, pixels.
    pub(super) dy: f32,
}

/// A value for every row of a tile.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Rows([f32; TILE_HEIGHT]);

/// The rows of a Gaussian inside a tile.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spans {
    peak_x: Rows,
    peak_log2: Rows,
    dy: Rows,
    /// First and last pixel, relative to the tile's left edge; the first is beyond the last where the row is not reached.
    first: Rows,
    last: Rows,
}

/// Numbers of the rows of a tile.
const NUMBERS: Rows = {
    let mut numbers = [0.0; TILE_HEIGHT];
    let mut row = 0;
    while row < TILE_HEIGHT {
        numbers[row] = row as f32;
        row += 1;
    }
    Rows(numbers)
};

impl Spans {
    pub(super) const fn new() -> Self {
        let rows = Rows([0.0; TILE_HEIGHT]);
        Self { peak_x: rows, peak_log2: rows, dy: rows, first: rows, last: rows }
    }

    /// Those of a Gaussian in the tile at `origin`: the part of each row in which it can reach the minimum alpha; the rows that it can reach.
    #[inline(always)]
    pub(super) fn set<S: Simd>(&mut self, simd: S, f: &Footprint, origin: [usize; 2]) -> Range<usize> {
        let rows = f.rows_in(origin[1]);
        let splat = |value: f32| simd.splat_f32s(value);
        let (centre, left) = (splat(origin[1] as f32 + 0.5), f.mean_x - origin[0] as f32);
        let (half_pixel, zero, right) = (splat(0.5), splat(0.0), splat(TILE_WIDTH as f32 - 1.0));
        for k in rows.start / S::F32_LANES..rows.end.div_ceil(S::F32_LANES) {
            let dy = simd.sub_f32s(simd.add_f32s(part::<S>(&NUMBERS)[k], centre), splat(f.mean_y));
            let peak_x = simd.add_f32s(splat(left), simd.mul_f32s(splat(f.shear), dy));
            let fall = simd.mul_f32s(simd.mul_f32s(splat(f.curve_y), dy), dy);
            let room = simd.add_f32s(splat(f.log2_opacity - LOG2_ALPHA_MIN), fall);
            let half = simd.sqrt_f32s(simd.mul_f32s(simd.max_f32s(room, zero), splat(f.width2)));
            let half = simd.add_f32s(half, splat(1e-3));
            let first = simd.sub_f32s(simd.sub_f32s(peak_x, half), half_pixel);
            let last = simd.sub_f32s(simd.add_f32s(peak_x, half), half_pixel);
            part_mut::<S>(&mut self.dy)[k] = dy;
            part_mut::<S>(&mut self.peak_x)[k] = peak_x;
            part_mut::<S>(&mut self.peak_log2)[k] = simd.add_f32s(splat(f.log2_opacity), fall);
            part_mut::<S>(&mut self.first)[k] = simd.max_f32s(first, zero);
            part_mut::<S>(&mut self.last)[k] = simd.min_f32s(last, right);
        }
        rows
    }

    /// One row, and a bit for each of its vectors of so many lanes that has a pixel to reach.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the tile before the cast")]
    pub(super) fn row(&self, row: usize, lanes: usize) -> (RowSpan, u32) {
        let span = RowSpan { peak_x: self.peak_x.0[row], peak_log2: self.peak_log2.0[row], dy: self.dy.0[row] };
        let (first, last) = (self.first.0[row], self.last.0[row]);
        // The cast of a non-negative float rounds down: at most one pixel too many at the left.
        let vectors = if first <= last { upto(last as u8, lanes) & !(upto(first as u8, lanes) >> 1) } else { 0 };
        (span, vectors)
    }
}

/// A bit for each vector of so many lanes up to that of a pixel.
#[inline(always)]
fn upto(pixel: u8, lanes: usize) -> u32 {
    const { assert!(TILE_WIDTH <= 32, "a row of a tile has a bit for every pixel") };
    u32::MAX >> (31 - (usize::from(pixel) / lanes) % 32)
}

#[inline(always)]
fn part<S: Simd>(rows: &Rows) -> &[S::f32s] {
    S::as_simd_f32s(&rows.0).0
}

#[inline(always)]
fn part_mut<S: Simd>(rows: &mut Rows) -> &mut [S::f32s] {
    S::as_mut_simd_f32s(&mut rows.0).0
}

#[cfg(test)]
mod tests {
    use pulp::{Arch, WithSimd};

    use super::*;

    /// Bits of the vectors of every row, and the rows, of so many lanes each.
    struct Reached<'a>(&'a Footprint, [usize; 2]);

    impl WithSimd for Reached<'_> {
        type Output = (Vec<(RowSpan, u32)>, Range<usize>, usize);

        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            let mut spans = Spans::new();
            let rows = spans.set(simd, self.0, self.1);
            ((0..TILE_HEIGHT).map(|row| spans.row(row, S::F32_LANES)).collect(), rows, S::F32_LANES)
        }
    }

    fn random(i: u32, salt: f32) -> f32 {
        ((i as f32 * 12.9898 + salt).sin() * 43_758.547).fract()
    }

    #[test]
    fn vectors_hold_every_pixel_that_can_be_reached_and_hardly_any_other() {
        let origin = [64, 32];
        let (mut reached, mut missed) = (0, 0);
        for i in 0..3000 {
            let half = 40.0 * random(i, 5.0).abs();
            let f = Footprint {
                mean_x: 80.0 + 40.0 * random(i, 0.1),
                mean_y: 40.0 + 30.0 * random(i, 0.7),
                shear: 2.0 * random(i, 1.3),
                curve_y: -0.7 / (0.3 + half),
                width2: 0.5 + 20.0 * random(i, 2.0).abs(),
                log2_opacity: -3.0 * random(i, 3.0).abs(),
                extent_y: half,
                extent_x: 99.0,
                ..Footprint::default()
            };
            for (rows, inside, lanes) in
                [Arch::new().dispatch(Reached(&f, origin)), Reached(&f, origin).with_simd(pulp::Scalar::new())]
            {
                for row in inside {
                    let (span, vectors) = rows[row];
                    let dy = (origin[1] + row) as f32 + 0.5 - f.mean_y;
                    let middle = f.mean_x - 64.0 + f.shear * dy;
                    assert!((span.dy - dy).abs() < 1e-5 && (span.peak_x - middle).abs() < 1e-4);
                    let half = f.half_width(dy);
                    for pixel in 0..TILE_WIDTH {
                        let beyond = (pixel as f32 + 0.5 - middle).abs() - half;
                        let taken = vectors >> (pixel / lanes) & 1 == 1;
                        assert!(taken || beyond > 0.0, "Gaussian {i} row {row} pixel {pixel}");
                        reached += usize::from(taken);
                        missed += usize::from(taken && beyond > lanes as f32 + 1.0);
                    }
                }
            }
        }
        assert!(reached > 100_000 && missed == 0, "{reached} {missed}");
    }
}
