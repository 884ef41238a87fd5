//! Rectangles of pixels, shape after shape.

use rayon::prelude::*;

use super::{Block, Sheet, fitted};
use crate::{gaussians::Coarseness, views::View};

/// Rows of an image in which the rectangles of one shape are looked for at once.
const BAND: usize = 32;
/// Pixels below which all rows are such a band.
const FEW: usize = 1 << 14;

/// What is looked for.
pub(super) struct Search<'a> {
    pub(super) view: &'a View,
    pub(super) sheet: &'a Sheet,
    pub(super) coarseness: Coarseness,
    /// In the order in which they are tried.
    pub(super) shapes: Vec<[usize; 2]>,
}

/// Rows of an image, from the `first` one on.
struct Rows<'a> {
    first: usize,
    /// Which of their pixels are in no rectangle yet, and how many of each row.
    left: &'a mut [bool],
    counts: &'a mut [usize],
}

impl Search<'_> {
    /// The rectangles, those of the first shape first.
    ///
    /// A shape goes down the image band by band, two bands behind the shape before it, which then has left all rows that it reaches; so
    /// all shapes are under way at once, and find what they would one after the other.
    pub(super) fn found(&self, left: &mut [bool], counts: &mut [usize]) -> Vec<Block> {
        let tallest = self.shapes.iter().map(|shape| shape[1]).max().unwrap_or(1);
        let is_few = counts.iter().sum::<usize>() < FEW;
        let band = if is_few { counts.len().max(1) } else { BAND.max(tallest) };
        self.found_by_bands(band, left, counts)
    }

    /// As [`Search::found`], by bands of so many rows, at least as many as the tallest shape has.
    fn found_by_bands(&self, band: usize, left: &mut [bool], counts: &mut [usize]) -> Vec<Block> {
        let (width, height) = (self.view.pinhole.width, counts.len());
        let num_bands = height.div_ceil(band);
        let mut found: Vec<Vec<Block>> = vec![Vec::new(); self.shapes.len()];
        let last = (num_bands + 2 * self.shapes.len()).saturating_sub(2);
        for step in 0..last {
            // Shape s is at band step - 2 s, and reaches into the next one.
            let above = ((step % 2) * band).min(height);
            let pairs = left[above * width..].par_chunks_mut((2 * band * width).max(1));
            let pairs = pairs.zip(counts[above..].par_chunks_mut(2 * band)).enumerate();
            let first = (step / 2 + 1).saturating_sub(self.shapes.len());
            let shapes = self.shapes.par_iter().zip(&mut found).take(step / 2 + 1).rev();
            pairs.skip(first).zip(shapes).for_each(|((pair, (left, counts)), (&shape, found))| {
                let rows = Rows { first: above + 2 * pair * band, left, counts };
                self.place(shape, rows, band, found);
            });
        }
        found.concat()
    }

    /// Adds the rectangles of a shape that begin in the first `band` of some rows.
    fn place(&self, size: [usize; 2], rows: Rows<'_>, band: usize, found: &mut Vec<Block>) {
        let ([columns, tall], Rows { first, left, counts }) = (size, rows);
        let (width, height) = (self.view.pinhole.width, self.view.pinhole.height);
        // Steps of half a side: finer ones find hardly more.
        let by = (tall / 2).max(1);
        let end = (first + band).min(height + 1 - tall);
        for row in (first.next_multiple_of(by)..end).step_by(by) {
            let mut column = 0;
            while column <= width - columns && counts[row - first] >= columns {
                let block = Block::new([column, row], size);
                let free = block.pixels(width).all(|pixel| left[pixel - first * width]);
                let block = free.then(|| fitted(self.view, self.sheet, block, self.coarseness)).flatten();
                column += match block {
                    Some(block) => {
                        block.pixels(width).for_each(|pixel| left[pixel - first * width] = false);
                        counts[row - first..row - first + tall].iter_mut().for_each(|count| *count -= columns);
                        found.push(block);
                        columns
                    }
                    None => (columns / 2).max(1),
                };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{BAND, Block, Search};
    use crate::{
        gaussians::{
            Coarseness,
            background::{Sheet, blocks::SHAPES, depth::Trust},
        },
        views::samples::{ahead, seen},
    };

    /// Patches of many sizes, some of which are taken already: bands change nothing.
    #[test]
    fn all_shapes_at_once_find_what_one_after_the_other_does() {
        let [width, height] = [150, 331];
        let count = width * height;
        let mixed = |i: usize| (i.wrapping_mul(0x9e37_79b9) >> 13) % 97;
        let patch = |pixel: usize| mixed(pixel / width / 23 * 31 + pixel % width / 17 + mixed(pixel / width / 5) % 3);
        let colours = (0..3 * count).map(|i| patch(i / 3) as f32 / 97.0).collect();
        let view = seen(ahead(width, height, 100.0), colours);
        let sheet = Sheet { inverse_depths: vec![0.1; count], trust: vec![Trust::Alone; count] };
        let search = Search { view: &view, sheet: &sheet, coarseness: Coarseness::default(), shapes: SHAPES.to_vec() };
        let found = |band: usize| {
            let mut left: Vec<bool> = (0..count).map(|pixel| mixed(pixel) > 1).collect();
            let mut counts: Vec<usize> =
                left.chunks(width).map(|row| row.iter().filter(|&&left| left).count()).collect();
            let blocks: Vec<Block> = search.found_by_bands(band, &mut left, &mut counts);
            (blocks, left, counts)
        };
        let tallest = SHAPES.iter().map(|shape| shape[1]).max().unwrap();
        let want = found(height);
        assert!(want.0.len() > 500, "{}", want.0.len());
        for band in [tallest, tallest + 1, BAND.max(tallest), 100] {
            assert!(found(band) == want, "bands of {band} rows");
        }
    }
}
