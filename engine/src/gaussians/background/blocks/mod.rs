//! Pixels that show nearly the same, together: the uncovered pixels of a view as rectangles of one colour and one plane each.

mod search;

use std::ops::Range;

use self::search::Search;
use super::{Sheet, is_ignored};
use crate::{
    gaussians::{Coarseness, disc::Plane},
    parallel,
    views::View,
};

/// Sides of the rectangles, width and height in pixels, in the order in which they are tried: large before small.
const SHAPES: [[usize; 2]; 26] = [
    [48, 48],
    [32, 32],
    [24, 24],
    [16, 16],
    [12, 12],
    [8, 8],
    [12, 4],
    [4, 12],
    [6, 6],
    [8, 3],
    [3, 8],
    [4, 4],
    [6, 2],
    [2, 6],
    [3, 3],
    [4, 2],
    [2, 4],
    [3, 2],
    [2, 3],
    [2, 2],
    [4, 1],
    [1, 4],
    [3, 1],
    [1, 3],
    [2, 1],
    [1, 2],
];
/// Longest side up to a coarseness of 1, pixels.
const LONGEST: f32 = 16.0;
/// Root mean square of the colours around their mean that four pixels may have.
const COLOUR: f32 = 0.015;
/// Inverse depths may be away from the plane through all of them by this share, and by so much more, 1 / metres.
const DEPTH: [f32; 2] = [0.1, 0.001];

/// Pixels that a thread looks at at once.
const GRAIN: usize = 4096;

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Block {
    /// Its first column and row.
    pub(super) corner: [usize; 2],
    /// Width and height, pixels.
    pub(super) size: [usize; 2],
    /// Its inverse depths, around its middle.
    pub(super) plane: Plane,
}

impl Block {
    /// One of unknown depths.
    const fn new(corner: [usize; 2], size: [usize; 2]) -> Self {
        Self { corner, size, plane: Plane { at: 0.0, by_column: 0.0, by_row: 0.0 } }
    }

    /// Row-major indices of its pixels in an image of this width.
    pub(super) fn pixels(&self, width: usize) -> impl Iterator<Item = usize> {
        let ([column, row], [columns, rows]) = (self.corner, self.size);
        (row..row + rows).flat_map(move |r| (column..column + columns).map(move |c| r * width + c))
    }

    /// Number of its pixels.
    pub(super) const fn num_pixels(&self) -> f32 {
        (self.size[0] * self.size[1]) as f32
    }

    /// Image position of its middle, pixels.
    pub(super) fn middle(&self) -> [f32; 2] {
        [0, 1].map(|k| self.corner[k] as f32 + 0.5 * self.size[k] as f32)
    }
}

/// The `open` pixels of a view of known depth as rectangles, each pixel in one of them.
///
/// Large ones are taken first, wherever they fit: they begin at no fixed grid, so that an edge of the scene costs as many small ones
/// wherever it lies.
///
/// `open`: whether the pixel of an index is, in the rows `band` of the image; none is in the others.
pub(super) fn blocks(
    view: &View,
    sheet: &Sheet,
    band: Range<usize>,
    open: impl Fn(usize) -> bool + Sync,
    coarseness: Coarseness,
) -> Vec<Block> {
    let [width, height] = [view.pinhole.width, view.pinhole.height];
    let known = |pixel: usize| open(pixel) && sheet.inverse_depths[pixel] > 0.0 && !is_ignored(view, pixel);
    let inside = band.start * width..band.end * width;
    let mut left = vec![false; view.pinhole.num_pixels()];
    parallel::for_each(&mut left[inside.clone()], GRAIN, &|i, left| *left = known(inside.start + i));
    let count = |row: usize| left[row * width..][..width].iter().filter(|&&left| left).count();
    let mut counts = parallel::map(height, 1, &count);
    let fits = |&[columns, rows]: &[usize; 2]| {
        columns.max(rows) as f32 <= coarseness.most(LONGEST) && columns <= width && rows <= height
    };
    let shapes: Vec<[usize; 2]> = SHAPES.into_iter().filter(fits).collect();
    let mut found = Search { view, sheet, coarseness, shapes }.found(&mut left, &mut counts);
    let alone = |pixel: usize| {
        let plane = Plane { at: sheet.inverse_depths[pixel], by_column: 0.0, by_row: 0.0 };
        Block { plane, ..Block::new([pixel % width, pixel / width], [1, 1]) }
    };
    found.extend(inside.filter(|&pixel| left[pixel]).map(alone));
    found
}

/// A rectangle of pixels that are alike, with their plane; `None` where they are not.
fn fitted(view: &View, sheet: &Sheet, block: Block, coarseness: Coarseness) -> Option<Block> {
    let (width, count) = (view.pinhole.width, block.num_pixels());
    let colour = |pixel: usize| -> [f32; 3] { std::array::from_fn(|k| view.image.data[3 * pixel + k]) };
    // From the first one: small numbers have small rounding errors.
    let first = colour(block.pixels(width).next()?);
    let (mut sums, mut squares) = ([0.0_f32; 3], 0.0_f32);
    for pixel in block.pixels(width) {
        let here = colour(pixel);
        for k in 0..3 {
            let gap = here[k] - first[k];
            sums[k] += gap;
            squares += gap * gap;
        }
    }
    let variance = (squares - sums.map(|s| s * s / count).iter().sum::<f32>()) / (3.0 * count);
    // Written so that a colour that is no number is like no other.
    let alike = variance <= coarseness.colour_variance(COLOUR, count);
    let depth = DEPTH.map(|d| coarseness.factor() * d);
    alike.then(|| plane(sheet, &block, width, depth)).flatten().map(|plane| Block { plane, ..block })
}

/// The plane of least squares through the inverse depths; `None` where one of them is too far from it.
fn plane(sheet: &Sheet, block: &Block, width: usize, [share, more]: [f32; 2]) -> Option<Plane> {
    let count = block.num_pixels();
    let half = block.size.map(|side| 0.5 * (side - 1) as f32);
    let place = |k: usize| [(k % block.size[0]) as f32 - half[0], (k / block.size[0]) as f32 - half[1]];
    let first = sheet.inverse_depths[block.pixels(width).next()?];
    let mut sums = [0.0_f32; 3];
    for (k, pixel) in block.pixels(width).enumerate() {
        let ([x, y], w) = (place(k), sheet.inverse_depths[pixel] - first);
        sums = [sums[0] + w, sums[1] + x * w, sums[2] + y * w];
    }
    // Squared distances of n places in a row from their middle, for m rows, add up to m n (n^2 - 1) / 12.
    let spread = |side: usize| count * ((side * side) as f32 - 1.0) / 12.0;
    // Through two pixels there is always a plane, across an edge of depth, too.
    let slope = |sum: f32, side: usize| if side > 2 { sum / spread(side) } else { 0.0 };
    let plane = Plane {
        at: first + sums[0] / count,
        by_column: slope(sums[1], block.size[0]),
        by_row: slope(sums[2], block.size[1]),
    };
    let most = share * plane.at + more;
    let near = |(k, pixel): (usize, usize)| (sheet.inverse_depths[pixel] - plane.inverse(place(k))).abs() <= most;
    (plane.at > 0.0 && block.pixels(width).enumerate().all(near)).then_some(plane)
}

#[cfg(test)]
mod tests {
    use super::{Block, blocks};
    use crate::{
        gaussians::{
            Coarseness,
            background::{Sheet, depth::Trust},
        },
        views::{
            View,
            samples::{ahead, seen},
        },
    };

    const SIZE: [usize; 2] = [70, 45];

    /// A view whose pixels (column, row) have this grey and inverse depth.
    fn scene(of: impl Fn(usize, usize) -> (f32, f32)) -> (View, Sheet) {
        let [width, height] = SIZE;
        let pixels: Vec<(f32, f32)> = (0..width * height).map(|i| of(i % width, i / width)).collect();
        let view = seen(ahead(width, height, 60.0), pixels.iter().flat_map(|&(grey, _)| [grey; 3]).collect());
        let inverse_depths: Vec<f32> = pixels.iter().map(|&(_, inverse)| inverse).collect();
        (view, Sheet { trust: vec![Trust::Confirmed; inverse_depths.len()], inverse_depths })
    }

    fn usual((view, sheet): &(View, Sheet)) -> Vec<Block> {
        blocks(view, sheet, 0..SIZE[1], |_| true, Coarseness::default())
    }

    #[test]
    fn every_open_pixel_is_in_one_rectangle() {
        let grey = |x: usize, y: usize| if (x * 7 + y * 13) % 29 < 4 { 0.9 } else { 0.3 };
        let (view, mut sheet) = scene(|x, y| (grey(x, y), 0.1));
        sheet.inverse_depths[5] = f32::NAN;
        let open: Vec<bool> = (0..SIZE[0] * SIZE[1]).map(|pixel| pixel % 11 != 3).collect();
        for factor in [0.0, 0.5, 1.0, 8.0] {
            let mut counts = vec![0; open.len()];
            for block in blocks(&view, &sheet, 0..SIZE[1], |pixel| open[pixel], Coarseness::new(factor).unwrap()) {
                block.pixels(SIZE[0]).for_each(|pixel| counts[pixel] += 1);
            }
            for (pixel, (&count, &open)) in counts.iter().zip(&open).enumerate() {
                assert_eq!(count, usize::from(open && pixel != 5), "pixel {pixel}, coarseness {factor}");
            }
        }
    }

    #[test]
    fn the_finest_are_single_pixels_and_a_plain_wall_takes_few() {
        let wall = scene(|_, _| (0.5, 0.1));
        let count = |coarseness| blocks(&wall.0, &wall.1, 0..SIZE[1], |_| true, coarseness).len();
        assert_eq!(count(Coarseness::FINEST), SIZE[0] * SIZE[1]);
        let [usual, coarse] = [1.0, 3.0].map(|factor| count(Coarseness::new(factor).unwrap()));
        assert!(usual < SIZE[0] * SIZE[1] / 30 && coarse < usual, "{usual} {coarse}");
    }

    #[test]
    fn no_rectangle_crosses_an_edge_wherever_it_lies() {
        for edge in [31, 32, 33, 37] {
            let sides = |block: &Block| (block.corner[0] < edge) != (block.corner[0] + block.size[0] <= edge);
            let of_colour = usual(&scene(|x, _| (if x < edge { 0.3 } else { 0.6 }, 0.1)));
            let of_depth = usual(&scene(|x, _| (0.5, if x < edge { 0.05 } else { 0.1 })));
            assert!(!of_colour.iter().chain(&of_depth).any(sides), "edge at {edge}");
        }
    }

    #[test]
    fn slanted_planes_are_found() {
        let plane = |x: f32, y: f32| 0.02 + 1e-4 * x + 1e-3 * y;
        for block in usual(&scene(|x, y| (0.5, plane(x as f32 + 0.5, y as f32 + 0.5)))) {
            let ([u, v], found) = (block.middle(), block.plane);
            assert!((found.at - plane(u, v)).abs() < 1e-5, "{block:?}");
            if block.size[0] > 2 && block.size[1] > 2 {
                assert!((found.by_column - 1e-4).abs() < 1e-5 && (found.by_row - 1e-3).abs() < 1e-5, "{block:?}");
            }
        }
    }
}
