//! Whether the colours of pixels go with a moving thing or with what stands.

use lgs_formats::casts::{to_f32, whole};

use super::{Thing, outline::Outline};
use crate::{
    gaussians::{USUAL_PIXELS, background::Sheet},
    parallel,
    points::{moved, sample},
    views::{Projected, View},
};

/// Difference of colours (mean over the channels) from which on they have nothing to do with each other.
const DIFFERENT: f32 = 0.2;
/// Reach of the window in which pixels, or squares of them, decide together: a share of the height of a thing, and at most so many.
const WINDOW: (f32, usize) = (0.06, 4);
/// Difference of colours at which pixels of a window no longer decide together.
const SAME_SURFACE: f32 = 0.06;
/// Squares that a thread takes at once.
const GRAIN: usize = 128;

/// How much better the pixels of an outline are explained by the thing than by what stands, by colours.
pub(super) struct Advantage {
    /// Of squares of pixels, row by row; 0 where no other image tells.
    of_squares: Vec<f32>,
    squares: Squares,
}

/// The squares of pixels of an outline, each of which is decided by the pixel in its corner.
#[derive(Clone, Copy, Debug)]
struct Squares {
    /// Side, pixels.
    side: usize,
    columns: usize,
    rows: usize,
    /// Column and row of the outline's corner.
    corner: [usize; 2],
}

impl Squares {
    /// Those of an outline: single pixels up to the usual size of an image.
    fn of(view: &View, outline: &Outline) -> Self {
        let side = whole(to_f32((view.pinhole.num_pixels() as f64 / USUAL_PIXELS).sqrt().round())).max(1);
        let [columns, rows] = outline.size().map(|size| size.div_ceil(side));
        Self { side, columns, rows, corner: [outline.columns.start, outline.rows.start] }
    }

    /// The pixel that decides for a square, in an image of a width.
    fn pixel(&self, column: usize, row: usize, width: usize) -> usize {
        (self.corner[1] + row * self.side) * width + self.corner[0] + column * self.side
    }
}

impl Advantage {
    /// That of an outline; `inverse` inverse depths of the thing in it, 1 / metres.
    pub(super) fn of(
        view: &View,
        sheet: &Sheet,
        thing: &Thing,
        outline: &Outline,
        inverse: &[f32],
        sources: &[&View],
    ) -> Self {
        let (width, squares) = (view.pinhole.width, Squares::of(view, outline));
        let advantage = |pixel: usize| {
            let [u, v] = [(pixel % width) as f32 + 0.5, (pixel / width) as f32 + 0.5];
            let colour = colour(view, pixel);
            let at = |inverse: f32| view.pinhole.unproject(Projected { u, v, depth: 1.0 / inverse });
            let place = at(inverse[outline.index(pixel / width, pixel % width)]);
            let taken = view.pinhole.time_at([u, v]);
            let velocity = thing.velocity_of(place, taken - thing.time);
            let there = |source: &View| {
                let seconds = source.pinhole.time - taken;
                source.pinhole.project_moving(moved(place, velocity, seconds), velocity)
            };
            let still = sheet.inverse_depths[pixel];
            let differ = |place: &dyn Fn(&View) -> Option<Projected>| {
                let source_difference = |source: &&View| Some(difference(colour, sample(source, place(source)?)?));
                sources.iter().filter_map(source_difference).reduce(f32::min)
            };
            let moves = differ(&there)?;
            let stands = differ(&|source| source.pinhole.project((still > 0.0).then(|| at(still))?))?;
            Some(stands - moves)
        };
        let count = squares.columns * squares.rows;
        let place = |k: usize| [k % squares.columns, k / squares.columns];
        let alone = |k: usize| advantage(squares.pixel(place(k)[0], place(k)[1], width)).unwrap_or(0.0);
        let alone: Vec<f32> = parallel::map(count, GRAIN, &alone);
        let reach = whole(WINDOW.0 * outline.height / squares.side as f32).clamp(1, WINDOW.1);
        let together = |k: usize| squares.together(view, &alone, place(k), reach);
        Self { of_squares: parallel::map(count, GRAIN, &together), squares }
    }

    /// That of a pixel, in a row and column of the image.
    pub(super) fn at(&self, row: usize, column: usize) -> f32 {
        let Squares { side, columns, corner: [left, top], .. } = self.squares;
        self.of_squares[(row - top) / side * columns + (column - left) / side]
    }
}

impl Squares {
    /// The mean over a window of what has the colour of its middle.
    fn together(&self, view: &View, advantages: &[f32], [column, row]: [usize; 2], reach: usize) -> f32 {
        let of = |column: usize, row: usize| colour(view, self.pixel(column, row, view.pinhole.width));
        let own = of(column, row);
        let (mut sum, mut total) = (0.0, 0.0);
        for r in row.saturating_sub(reach)..(row + reach + 1).min(self.rows) {
            for c in column.saturating_sub(reach)..(column + reach + 1).min(self.columns) {
                let weight = (-difference(own, of(c, r)) / SAME_SURFACE).exp();
                sum += weight * advantages[r * self.columns + c];
                total += weight;
            }
        }
        sum / total
    }
}

fn colour(view: &View, pixel: usize) -> [f32; 3] {
    std::array::from_fn(|k| view.image.data[3 * pixel + k])
}

fn difference(a: [f32; 3], b: [f32; 3]) -> f32 {
    ((0..3).map(|k| (a[k] - b[k]).abs()).sum::<f32>() / 3.0).min(DIFFERENT)
}

#[cfg(test)]
mod tests {
    use super::{Advantage, Outline, Squares};
    use crate::views::samples::{ahead, seen};

    #[test]
    fn every_pixel_of_a_large_image_is_decided_by_one_that_is_near_and_inside() {
        for (width, height, side) in [(960, 540, 1), (1920, 1080, 2), (2880, 1640, 3)] {
            let view = seen(ahead(width, height, 900.0), vec![0.5; 3 * width * height]);
            let outline = Outline { columns: 101..138, rows: 50..77, height: 20.0 };
            let squares = Squares::of(&view, &outline);
            assert_eq!(squares.side, side);
            let count = squares.columns * squares.rows;
            let advantage = Advantage { of_squares: (0..count).map(|k| k as f32).collect(), squares };
            for (row, column) in (50..77).flat_map(|row| (101..138).map(move |column| (row, column))) {
                let square = (0..count).find(|&k| k as f32 == advantage.at(row, column)).unwrap();
                let pixel = squares.pixel(square % squares.columns, square / squares.columns, width);
                let (decides, beside) = ([pixel / width, pixel % width], [row, column]);
                assert!(
                    (0..2).all(|k| decides[k] <= beside[k] && beside[k] < decides[k] + side),
                    "{decides:?} {beside:?}"
                );
            }
        }
    }
}
