//! The rendering loss: value and gradient by the rendered images.
//!
//! `0.8 L1 + 0.2 (1 - SSIM) + 0.01 depth + 0.01 velocity`. Pixels whose label is `Ignored` take no part: for colours the
//! truth stands in for what was rendered there, so they cost nothing and have no gradient, the mean absolute error is over
//! the other pixels, and the mean similarity over the window centres that are not ignored.

mod costs;
mod depth;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
mod kept;
mod l1;
mod map;
mod psnr;
mod residual;
pub mod ssim;
mod velocity;

use std::cell::RefCell;

use lgs_formats::image::PixelLabel;
use rayon::prelude::*;

use crate::{
    parallel,
    render::{ImageGradient, Rendered},
    views::View,
};
pub use costs::pixel_costs;
pub(crate) use depth::depth_errors;
pub use kept::Kept;
pub use map::{LossCounts, LossMap, loss_map, patch_change};
pub use residual::residual_image;
use ssim::ImagePair;
pub use velocity::velocity_loss;

/// Pixels that a thread takes at once.
const GRAIN: usize = 1 << 14;

/// Weights of the terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LossWeights {
    /// Of the mean absolute colour error.
    pub l1: f32,
    /// Of `1 - SSIM`.
    pub ssim: f32,
    /// Of the mean absolute error of the expected depth, per metre.
    pub depth: f32,
    /// Of the mean speed, per metre a second.
    pub velocity: f32,
    /// Of the peak signal-to-noise ratio, per decibel that is missing: no part of the loss as it is defined, for training towards it.
    pub psnr: f32,
}

impl Default for LossWeights {
    fn default() -> Self {
        Self { l1: 0.8, ssim: 0.2, depth: 0.01, velocity: 0.01, psnr: 0.0 }
    }
}

/// The terms of one image's loss, unweighted, and their weighted sum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LossTerms {
    /// Mean absolute colour error.
    pub l1: f64,
    /// Mean structural similarity; `None` for an image smaller than its window, or all of whose centres are ignored. The
    /// term is then absent from the loss.
    pub ssim: Option<f64>,
    /// Mean absolute error of the expected depth, metres; 0 without a depth sample.
    pub depth: f64,
    /// Weighted sum of the terms above.
    pub total: f64,
}

/// Loss of one rendered view, and its gradient by the rendered colours and the expected depth.
///
/// # Shapes
/// `rendered` has the size of `view`. Gradient: `rgb` `[H, W, 3]`, `expected_depth` `[H, W]` or empty; `alpha` and `depth`
/// empty (zeros).
///
/// # Formula
/// `l1 L1 + ssim (1 - SSIM) + depth D - psnr PSNR`; the velocity term is [`velocity_loss`].
///
/// # Gradient
/// Exact; the truth and the LiDAR are constants. A rendered value that is not finite makes the terms that see it, and
/// `total`, not finite: callers that go on with the gradient look at `total` first.
pub fn image_loss(rendered: &Rendered, view: &View, weights: &LossWeights) -> (LossTerms, ImageGradient) {
    let (labels, mut rgb) = (labels_of(view), vec![0.0; rendered.rgb.len()]);
    let (terms, psnr) = with_ignored_filled(rendered, view, labels, |pair, num_values| {
        let l1 = l1::l1(pair.rendered, pair.truth, num_values, weights.l1, &mut rgb);
        let psnr = match weights.psnr {
            0.0 => 0.0,
            weight => psnr::add_psnr_gradient(pair.rendered, pair.truth, num_values, weight, &mut rgb),
        };
        let ssim = ssim::add_ssim_gradient(pair, labels, -weights.ssim, &mut rgb);
        if let Some(labels) = labels {
            zero_ignored(&mut rgb, 3, labels);
        }
        ((l1, ssim), psnr)
    });
    let (depth, expected_depth) = depth::depth_loss(rendered, &view.depth_samples, labels, weights.depth);
    let terms = LossTerms::of(terms, depth, psnr, weights);
    (terms, ImageGradient { rgb, expected_depth, ..ImageGradient::default() })
}

/// The loss of [`image_loss`] alone, to the bit.
///
/// # Shapes
/// `rendered` has the size of `view`.
pub fn image_loss_terms(rendered: &Rendered, view: &View, weights: &LossWeights) -> LossTerms {
    if weights.psnr != 0.0 {
        return image_loss(rendered, view, weights).0;
    }
    let labels = labels_of(view);
    let terms = with_ignored_filled(rendered, view, labels, |pair, num_values| {
        (l1::mean_difference(pair.rendered, pair.truth, num_values), ssim::mean_similarity(pair, labels))
    });
    let (depth, _) = depth::depth_loss(rendered, &view.depth_samples, labels, weights.depth);
    LossTerms::of(terms, depth, 0.0, weights)
}

impl LossTerms {
    /// Of L1 and similarity, depth error and peak signal-to-noise ratio.
    fn of((l1, ssim): (f64, Option<f64>), depth: f64, psnr: f64, weights: &LossWeights) -> Self {
        let total = f64::from(weights.l1) * l1
            + ssim.map_or(0.0, |ssim| f64::from(weights.ssim) * (1.0 - ssim))
            + f64::from(weights.depth) * depth
            - f64::from(weights.psnr) * psnr;
        Self { l1, ssim, depth, total }
    }
}

/// The labels of a view that has pixels that are ignored.
fn labels_of(view: &View) -> Option<&[PixelLabel]> {
    view.labels.as_deref().filter(|labels| has_ignored(labels))
}

/// What `compare` finds of a rendered image, with the truth in place of the pixels that `labels` ignore, and the true one; it gets the number of
/// values that take part.
fn with_ignored_filled<T>(
    rendered: &Rendered,
    view: &View,
    labels: Option<&[PixelLabel]>,
    compare: impl FnOnce(&ImagePair<'_>, usize) -> T,
) -> T {
    let mut filled = FILLED.with(RefCell::take);
    let colours: &[f32] = match labels {
        Some(labels) => {
            fill_ignored(&rendered.rgb, &view.image.data, labels, &mut filled);
            &filled
        }
        None => &rendered.rgb,
    };
    let (width, height) = (rendered.width, rendered.height);
    let pair = ImagePair { truth: &view.image.data, rendered: colours, width, height };
    let num_ignored = labels.map_or(0, |labels| pixels(labels).filter(|&&label| label == PixelLabel::Ignored).count());
    let found = compare(&pair, colours.len() - 3 * num_ignored);
    FILLED.with(|kept| kept.replace(filled));
    found
}

thread_local! {
    /// Colours of the last call that had ignored pixels, kept for its pages.
    static FILLED: RefCell<Vec<f32>> = const { RefCell::new(Vec::new()) };
}

/// Writes the rendered colours to `filled`, with the truth in place of the ignored ones.
///
/// # Shapes
/// `rendered`, `truth` and `filled` `[H, W, 3]`, `labels` `[H, W]`.
pub(crate) fn fill_ignored(rendered: &[f32], truth: &[f32], labels: &[PixelLabel], filled: &mut Vec<f32>) {
    filled.resize(rendered.len(), 0.0);
    parallel::for_chunks(filled, 3 * GRAIN, &|number, filled| {
        let start = 3 * GRAIN * number;
        filled.copy_from_slice(&rendered[start..][..filled.len()]);
        let labels = labels.get(number * GRAIN..).unwrap_or_default();
        let colours = filled.chunks_exact_mut(3).zip(truth[start..].chunks_exact(3)).zip(labels);
        for ((colour, true_colour), label) in colours {
            if *label == PixelLabel::Ignored {
                colour.copy_from_slice(true_colour);
            }
        }
    });
}

/// Sets the values of the pixels that are ignored to zero.
///
/// # Shapes
/// `values` `[H, W, channels]`, `labels` `[H, W]`.
fn zero_ignored(values: &mut [f32], channels: usize, labels: &[PixelLabel]) {
    parallel::for_chunks(values, channels * GRAIN, &|number, values| {
        let labels = labels.get(number * GRAIN..).unwrap_or_default();
        for (of_pixel, label) in values.chunks_exact_mut(channels).zip(labels) {
            if *label == PixelLabel::Ignored {
                of_pixel.fill(0.0);
            }
        }
    });
}

/// `[H, W]` 1 where a pixel takes part, 0 where it is ignored.
pub(crate) fn counted_pixels(view: &View) -> Vec<f32> {
    let mut counted = vec![1.0; view.pinhole.width * view.pinhole.height];
    zero_ignored(&mut counted, 1, view.labels.as_deref().unwrap_or_default());
    counted
}

/// The labels of the pixels, in parallel.
fn pixels(labels: &[PixelLabel]) -> impl ParallelIterator<Item = &PixelLabel> {
    labels.par_iter().with_min_len(GRAIN)
}

/// Whether any pixel takes no part.
fn has_ignored(labels: &[PixelLabel]) -> bool {
    pixels(labels).any(|&label| label == PixelLabel::Ignored)
}

#[cfg(test)]
mod tests;
