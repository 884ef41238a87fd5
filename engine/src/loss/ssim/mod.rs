//! Structural similarity of two images and its gradient by the rendered one.
//!
//! 11 x 11 Gaussian window of standard deviation 1.5 pixels, `C1 = 0.01^2`, `C2 = 0.03^2`, values in 0..=1, population
//! variances, the mean over all window centres whose window lies inside the image and over the three channels
//! ("cropped", as `pytorch-msssim` computes it). An image with a side below 11 pixels has no such centre: its similarity is
//! undefined and every function here says `None`.
//!
//! # Source
//! Wang, Bovik, Sheikh, Simoncelli: Image quality assessment, from error visibility to structural similarity (2004),
//! equation 13.

mod backward;
pub(super) mod forward;
pub(super) mod window;

#[cfg(test)]
mod reference;

use std::cell::RefCell;

use lgs_formats::image::PixelLabel;
use pulp::Arch;
use rayon::prelude::*;

use backward::{GatherRow, SpreadRow};
use forward::{Moments, RowSlopes, RowValues, VerticalMoments};
use window::{CHANNELS, MARGIN, SLACK, WINDOW};

use crate::parallel;

/// Rows that a thread takes at a time; results do not depend on it.
const ROWS_PER_TASK: usize = 8;

/// Two images of one size.
#[derive(Clone, Copy, Debug)]
pub struct ImagePair<'a> {
    /// `[H, W, 3]` true values.
    pub truth: &'a [f32],
    /// `[H, W, 3]` rendered values.
    pub rendered: &'a [f32],
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
}

/// Similarity at every window centre.
#[derive(Clone, Debug, PartialEq)]
pub struct SimilarityMap {
    /// Window centres in a row, `W - 10`.
    pub width: usize,
    /// Rows of window centres, `H - 10`.
    pub height: usize,
    /// `[H - 10, W - 10, 3]` similarities.
    pub values: Vec<f32>,
}

impl SimilarityMap {
    /// Mean over the channels and the window centres for which `keep` (by row-major pixel index in the image) holds;
    /// `None` when there is none.
    pub fn mean_where(&self, keep: impl Fn(usize) -> bool) -> Option<f64> {
        let (mut sum, mut count) = (0.0_f64, 0_usize);
        for (i, pixel) in self.values.chunks_exact(CHANNELS).enumerate() {
            if keep(image_index(i / self.width, i % self.width, self.width)) {
                sum += pixel.iter().map(|&v| f64::from(v)).sum::<f64>();
                count += CHANNELS;
            }
        }
        (count > 0).then(|| sum / count as f64)
    }
}

/// Row-major index in the image of the pixel under a window centre.
fn image_index(row: usize, column: usize, centres_per_row: usize) -> usize {
    (row + WINDOW / 2) * (centres_per_row + WINDOW - 1) + column + WINDOW / 2
}

/// Numbers of window centres, when there are any.
struct Centres {
    width: usize,
    height: usize,
}

impl Centres {
    fn of(pair: &ImagePair) -> Option<Self> {
        (pair.width >= WINDOW && pair.height >= WINDOW)
            .then(|| Self { width: pair.width - WINDOW + 1, height: pair.height - WINDOW + 1 })
    }

    /// How many similarities there are at centres that are not ignored; `None` where there is none.
    fn num_values(&self, labels: Option<&[PixelLabel]>) -> Option<usize> {
        let ignored =
            |row: usize| (0..self.width).filter(|&c| is_ignored(labels, image_index(row, c, self.width))).count();
        let num_ignored: usize = if labels.is_some() { (0..self.height).map(ignored).sum() } else { 0 };
        let count = self.height * self.width - num_ignored;
        (count > 0).then_some(count * CHANNELS)
    }
}

/// The eleven image rows under the window centres of `row`.
fn window_rows(image: &[f32], row: usize, width: usize) -> [&[f32]; WINDOW] {
    std::array::from_fn(|k| &image[(row + k) * width * CHANNELS..][..width * CHANNELS])
}

/// Similarity at every window centre; `None` for an image smaller than the window.
pub fn similarity_map(pair: &ImagePair) -> Option<SimilarityMap> {
    let centres = Centres::of(pair)?;
    let (arch, window, len) = (Arch::new(), window::window(), centres.width * CHANNELS);
    let mut values = vec![0.0; centres.height * len];
    values.par_chunks_mut(len).enumerate().with_min_len(ROWS_PER_TASK).for_each_init(
        || (Moments::new(pair.width * CHANNELS), vec![0.0; len + SLACK]),
        |(moments, row_values), (row, out)| {
            vertical_moments(arch, &window, pair, row, moments);
            arch.dispatch(RowValues { window: &window, moments, len, values: row_values });
            out.copy_from_slice(&row_values[..len]);
        },
    );
    Some(SimilarityMap { width: centres.width, height: centres.height, values })
}

fn vertical_moments(arch: Arch, window: &[f32; WINDOW], pair: &ImagePair, row: usize, moments: &mut Moments) {
    arch.dispatch(VerticalMoments {
        window,
        truth: window_rows(pair.truth, row, pair.width),
        rendered: window_rows(pair.rendered, row, pair.width),
        moments,
    });
}

/// Mean similarity over the window centres that are not ignored, with `weight` times its gradient by the rendered image
/// added to `gradient`; `None`, and nothing added, when there is no such centre.
///
/// # Shapes
/// `labels` `[H, W]`, `gradient` `[H, W, 3]`.
///
/// # Gradient
/// Exact. A rendered value acts through `E[b]`, `E[d^2]` and `E[b^2]` of every window that sees it; each is spread back with
/// the same window. Values are taken as they are: one that is not finite reaches the windows around it and the mean.
pub fn add_ssim_gradient(
    pair: &ImagePair,
    labels: Option<&[PixelLabel]>,
    weight: f32,
    gradient: &mut [f32],
) -> Option<f64> {
    let centres = Centres::of(pair)?;
    let count = centres.num_values(labels)?;
    let mut spread = SPREAD.with(RefCell::take);
    let row_sums = spread_slopes(pair, labels, &centres, &mut spread);
    gather_gradient(pair, &centres, &spread, weight / count as f32, gradient);
    SPREAD.with(|kept| kept.replace(spread));
    Some(row_sums.iter().sum::<f64>() / count as f64)
}

/// Mean similarity over the window centres that are not ignored, to the bit that of [`add_ssim_gradient`]; `None` when there is no such centre.
///
/// # Shapes
/// `labels` `[H, W]`.
pub fn mean_similarity(pair: &ImagePair, labels: Option<&[PixelLabel]>) -> Option<f64> {
    let centres = Centres::of(pair)?;
    let count = centres.num_values(labels)?;
    let (arch, window, len) = (Arch::new(), window::window(), centres.width * CHANNELS);
    let sums_of = |task: usize| -> Vec<f64> {
        let (mut moments, mut values) = (Moments::new(pair.width * CHANNELS), vec![0.0; len + SLACK]);
        let rows = task * ROWS_PER_TASK..centres.height.min((task + 1) * ROWS_PER_TASK);
        let sum_of = |row: usize| {
            vertical_moments(arch, &window, pair, row, &mut moments);
            arch.dispatch(RowValues { window: &window, moments: &moments, len, values: &mut values });
            let ignored = (0..centres.width).filter(|&c| is_ignored(labels, image_index(row, c, centres.width)));
            ignored.for_each(|column| values[column * CHANNELS..(column + 1) * CHANNELS].fill(0.0));
            arch.dispatch(|| window::sum(&values[..len]))
        };
        rows.map(sum_of).collect()
    };
    let sums = parallel::map(centres.height.div_ceil(ROWS_PER_TASK), 1, &sums_of);
    Some(sums.iter().flatten().sum::<f64>() / count as f64)
}

thread_local! {
    /// Spread slopes of the last call, kept because fresh pages cost more than the arithmetic. It is taken out while in
    /// use, so a call that a worker thread steals in the middle of another starts with an empty one.
    static SPREAD: RefCell<Vec<f32>> = const { RefCell::new(Vec::new()) };
}

fn is_ignored(labels: Option<&[PixelLabel]>, pixel: usize) -> bool {
    labels.is_some_and(|labels| labels[pixel] == PixelLabel::Ignored)
}

/// Sum of the similarities of each row of window centres; fills `spread` with the slopes, spread along the rows.
///
/// # Shapes
/// `spread` `[H - 10, 3, 3 W]`.
fn spread_slopes(
    pair: &ImagePair,
    labels: Option<&[PixelLabel]>,
    centres: &Centres,
    spread: &mut Vec<f32>,
) -> Vec<f64> {
    let (arch, window) = (Arch::new(), window::window());
    let (row_len, len) = (pair.width * CHANNELS, centres.width * CHANNELS);
    let size = centres.height * 3 * row_len;
    if spread.len() < size {
        spread.resize(size, 0.0);
    }
    let mut row_sums = vec![0.0_f64; centres.height];
    let tasks = spread[..size].par_chunks_mut(3 * row_len).zip(&mut row_sums).enumerate();
    tasks.with_min_len(ROWS_PER_TASK).for_each_init(
        || RowScratch::new(row_len),
        |scratch, (row, (out, row_sum))| {
            let RowScratch { moments, values, slopes } = scratch;
            vertical_moments(arch, &window, pair, row, moments);
            arch.dispatch(RowSlopes { window: &window, moments, len, values, slopes });
            if let Some(labels) = labels {
                for column in
                    (0..centres.width).filter(|&c| labels[image_index(row, c, centres.width)] == PixelLabel::Ignored)
                {
                    let at = column * CHANNELS..(column + 1) * CHANNELS;
                    slopes.iter_mut().for_each(|s| s[MARGIN + at.start..MARGIN + at.end].fill(0.0));
                    values[at].fill(0.0);
                }
            }
            for (slopes, spread) in slopes.iter().zip(out.chunks_exact_mut(row_len)) {
                arch.dispatch(SpreadRow { window: &window, slopes, spread });
            }
            *row_sum = arch.dispatch(|| window::sum(&values[..len]));
        },
    );
    row_sums
}

/// Buffers of one thread for one row of window centres.
struct RowScratch {
    moments: Moments,
    values: Vec<f32>,
    slopes: [Vec<f32>; 3],
}

impl RowScratch {
    fn new(row_len: usize) -> Self {
        Self {
            moments: Moments::new(row_len),
            values: vec![0.0; row_len + SLACK],
            slopes: std::array::from_fn(|_| vec![0.0; row_len + MARGIN]),
        }
    }
}

/// Adds `scale` times the gradient of the sum of all similarities.
fn gather_gradient(pair: &ImagePair, centres: &Centres, spread: &[f32], scale: f32, gradient: &mut [f32]) {
    let (arch, window) = (Arch::new(), window::window());
    let row_len = pair.width * CHANNELS;
    gradient.par_chunks_mut(row_len).enumerate().with_min_len(ROWS_PER_TASK).for_each_init(
        || vec![0.0; row_len],
        |of_row, (row, out)| {
            let first = row.saturating_sub(WINDOW - 1);
            let last = row.min(centres.height - 1);
            let image_row = row * row_len..(row + 1) * row_len;
            arch.dispatch(GatherRow {
                window: &window[first + WINDOW - 1 - row..],
                spread: &spread[first * 3 * row_len..(last + 1) * 3 * row_len],
                truth: &pair.truth[image_row.clone()],
                rendered: &pair.rendered[image_row],
                gradient: of_row,
            });
            arch.dispatch(|| out.iter_mut().zip(&*of_row).for_each(|(o, g)| *o += scale * g));
        },
    );
}

#[cfg(test)]
mod tests;
