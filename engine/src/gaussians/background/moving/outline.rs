//! Where in an image the pixels of a moving thing may be.

use lgs_formats::casts::whole;

use crate::{
    parallel,
    views::{DepthSample, View},
};

/// How far beside, above and below its returns a thing may reach, shares of their width and height in the image.
const BEYOND: [f32; 3] = [0.15, 0.5, 0.2];

/// Pixels that a thread takes at once.
const GRAIN: usize = 256;

/// The rectangle in which a thing's pixels are looked for.
#[derive(Clone, Debug)]
pub(super) struct Outline {
    pub(super) columns: std::ops::Range<usize>,
    pub(super) rows: std::ops::Range<usize>,
    /// Height of what the returns cover, pixels.
    pub(super) height: f32,
}

impl Outline {
    pub(super) fn of(view: &View, own: &[DepthSample]) -> Self {
        let (width, height) = (view.pinhole.width, view.pinhole.height);
        let ends = |of: &dyn Fn(usize) -> usize| {
            let places = || own.iter().map(|sample| of(sample.pixel as usize));
            [places().min().unwrap_or_default(), places().max().unwrap_or_default() + 1]
        };
        let [left, right] = ends(&|pixel| pixel % width);
        let [top, bottom] = ends(&|pixel| pixel / width);
        let share = |share: f32, of: usize| whole(share * of as f32) + 2;
        let (beside, tall) = (share(BEYOND[0], right - left), bottom - top);
        Self {
            columns: left.saturating_sub(beside)..(right + beside).min(width),
            rows: top.saturating_sub(share(BEYOND[1], tall))..(bottom + share(BEYOND[2], tall)).min(height),
            height: tall as f32,
        }
    }

    /// Row-major indices of its pixels in an image of this width, each with what a function says of it.
    pub(super) fn pixels(&self, width: usize, f: &(dyn Fn(usize) -> bool + Sync)) -> Vec<(usize, bool)> {
        let (columns, corner) = (self.columns.len(), self.rows.start * width + self.columns.start);
        let pixel = |index: usize| corner + index / columns * width + index % columns;
        parallel::map(columns * self.rows.len(), GRAIN, &|index| (pixel(index), f(pixel(index))))
    }

    /// Which of its pixels samples of an image of a width fall on.
    pub(super) fn marked<'a>(&self, width: usize, samples: impl Iterator<Item = &'a DepthSample>) -> Vec<bool> {
        let mut marked = vec![false; self.columns.len() * self.rows.len()];
        for &DepthSample { pixel, .. } in samples {
            let (row, column) = (pixel as usize / width, pixel as usize % width);
            if self.rows.contains(&row) && self.columns.contains(&column) {
                marked[self.index(row, column)] = true;
            }
        }
        marked
    }

    /// Width and height, pixels.
    pub(super) fn size(&self) -> [usize; 2] {
        [self.columns.len(), self.rows.len()]
    }

    /// Samples of an image of a width, all of them inside, as those of an image of this rectangle alone.
    pub(super) fn inside(&self, width: usize, samples: &[DepthSample]) -> Vec<DepthSample> {
        let inner = |&DepthSample { pixel, depth }: &DepthSample| {
            let index = self.index(pixel as usize / width, pixel as usize % width);
            Some(DepthSample { pixel: u32::try_from(index).ok()?, depth })
        };
        samples.iter().filter_map(inner).collect()
    }

    pub(super) fn index(&self, row: usize, column: usize) -> usize {
        (row - self.rows.start) * self.columns.len() + column - self.columns.start
    }
}
