//! The loss of a view on a GPU, and its gradient: the images stay there.
//!
//! Sums over pixels are those of groups of 256, in a fixed tree in f32, then in f64 by the processor.

use bytemuck::{Pod, Zeroable};
use lgs_formats::casts::to_u32;
use lgs_formats::image::PixelLabel;
use rayon::prelude::*;
use wgpu::Buffer;

use super::map::LossCounts;
use super::residual::DEPTH;
use super::ssim::forward::{C1, C2};
use super::ssim::window::{WINDOW, window};
use super::{Kept, LossTerms, LossWeights};
use crate::render::gpu::{Drawn, GpuError, Kernel, Told, ViewCosts, Work, groups_over, single};
use crate::views::View;

const PAIR: &str = include_str!("pair.wgsl");
const COMPARE: Kernel = Kernel::with("compare", &[PAIR, include_str!("similarity.wgsl")], similarity_constants);
const DESCEND: Kernel = Kernel::with("descend", &[PAIR, include_str!("gradient.wgsl")], similarity_constants);
const PIXELS: &[&str] = &[PAIR, include_str!("residual.wgsl")];
const TAKE_RESIDUAL: Kernel = Kernel::new("take_residual", PIXELS);
const TAKE_AGREEMENT: Kernel = Kernel::new("take_agreement", PIXELS);

/// Side of the block of pixels that a group takes.
const BLOCK: u32 = 16;
const CHANNELS: u32 = 3;
/// Numbers of a pixel's gradient: by colours and expected depth; by accumulated alpha and depth, two maps.
const PIXEL_GRADIENT: usize = 8;

/// What the kernels are told of a view.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Pair {
    size: [u32; 4],
    slopes: [f32; 4],
    first: [u32; 4],
}

/// Where the sums of some views' losses are gathered.
#[derive(Debug)]
pub(crate) struct LossSums {
    similarities: Buffer,
    errors: Buffer,
    weights: LossWeights,
    views: Vec<OfView>,
}

/// A view's place among the sums.
#[derive(Clone, Copy, Debug)]
struct OfView {
    counts: LossCounts,
    /// First of its similarities, and of its errors.
    first: u32,
    /// Groups over its pixels.
    pixels: [u32; 2],
    /// Groups over its window centres.
    centres: [u32; 2],
    /// Columns and rows of window centres.
    size: [u32; 2],
}

/// The truth of a view on the GPU.
#[derive(Debug)]
pub(crate) struct Truth {
    pixels: Buffer,
    pair: Told,
    view: OfView,
    num_pixels: usize,
}

impl LossSums {
    /// Room for the sums of views.
    ///
    /// # Errors
    /// Where the GPU has not so much room.
    pub(crate) fn new(work: &mut Work<'_>, views: &[&View], weights: &LossWeights) -> Result<Self, GpuError> {
        let mut first = 0;
        let of_view = |view: &&View| {
            let size = [view.pinhole.width, view.pinhole.height].map(to_u32);
            let margin = to_u32(WINDOW - 1);
            let centres = if size.iter().all(|&side| side > margin) { size.map(|side| side - margin) } else { [0; 2] };
            let part = OfView {
                counts: LossCounts::of(view),
                first,
                pixels: size.map(|side| side.div_ceil(BLOCK)),
                centres: centres.map(|side| side.div_ceil(BLOCK)),
                size: centres,
            };
            first += CHANNELS * part.pixels[0] * part.pixels[1];
            part
        };
        let views: Vec<OfView> = views.iter().map(of_view).collect();
        let similarities = work.buffer::<f32>("sums of similarities", first as usize)?;
        let errors = work.buffer::<[f32; 2]>("sums of errors", first as usize)?;
        Ok(Self { similarities, errors, weights: *weights, views })
    }

    /// The truth of the view of a number: one that is kept, where it is.
    ///
    /// # Errors
    /// Where the GPU has not so much room.
    pub(crate) fn truth<'v>(
        &self,
        work: &mut Work<'_>,
        number: usize,
        view: &'v View,
        kept: &mut Kept<'v>,
    ) -> Result<Truth, GpuError> {
        let place = self.views[number];
        let pixels = kept.truth(work, view)?;
        let size = [view.pinhole.width, view.pinhole.height].map(to_u32);
        let pair = Pair {
            size: [size[0], size[1], place.size[0], place.size[1]],
            slopes: [
                over(self.weights.l1, 3 * place.counts.pixels),
                over(self.weights.ssim, 3 * place.counts.centres),
                over(self.weights.depth, place.counts.samples),
                DEPTH,
            ],
            first: [place.first, 0, 0, 0],
        };
        Ok(Truth { pixels, pair: work.tell(&pair), view: place, num_pixels: view.pinhole.num_pixels() })
    }

    /// The gradient of a drawn view's loss by its pixels; its sums are kept.
    ///
    /// # Shapes
    /// Result `[H, W, 2, 4]`, as [`Work::add_backward`] takes it.
    ///
    /// # Errors
    /// Where the GPU has not so much room.
    pub(crate) fn gradient(&self, work: &mut Work<'_>, truth: &Truth, drawn: &Drawn) -> Result<Buffer, GpuError> {
        let OfView { pixels, centres, size, .. } = truth.view;
        let slopes = work.buffer::<[f32; 9]>("slopes of similarities", size[0] as usize * size[1] as usize)?;
        let gradients = pixel_gradients(work, truth)?;
        if size[0] > 0 {
            let bindings = [(1, &truth.pixels), (2, &drawn.image), (3, &slopes), (4, &self.similarities)];
            work.run_over(&COMPARE, &[&truth.pair], &bindings, [centres[0], centres[1], CHANNELS]);
        }
        let bindings =
            [(1, &truth.pixels), (2, &drawn.image), (3, &slopes), (4, &drawn.ends), (5, &gradients), (6, &self.errors)];
        work.run_over(&DESCEND, &[&truth.pair], &bindings, [pixels[0], pixels[1], CHANNELS]);
        Ok(gradients)
    }

    /// The terms of every view.
    ///
    /// # Errors
    /// Where the GPU has stopped.
    pub(crate) fn terms(&self, work: &mut Work<'_>) -> Result<Vec<LossTerms>, GpuError> {
        let last = self.views.last().map_or(0, |of| of.first + CHANNELS * of.pixels[0] * of.pixels[1]) as usize;
        let similarities = work.read::<f32>(&self.similarities, 0, last)?;
        let errors = work.read::<[f32; 2]>(&self.errors, 0, last)?;
        Ok(self.views.iter().map(|of| self.terms_of(of, &similarities, &errors)).collect())
    }

    fn terms_of(&self, of: &OfView, similarities: &[f32], errors: &[[f32; 2]]) -> LossTerms {
        let LossCounts { pixels, centres, samples } = of.counts;
        let part = |groups: [u32; 2]| of.first as usize..(of.first + CHANNELS * groups[0] * groups[1]) as usize;
        let mean = |sum: f64, count: usize| if count == 0 { 0.0 } else { sum / count as f64 };
        let [mut colour, mut deep] = [0.0; 2];
        for [error, depth] in &errors[part(of.pixels)] {
            colour += f64::from(*error);
            deep += f64::from(*depth);
        }
        let similar: f64 = similarities[part(of.centres)].iter().map(|&sum| f64::from(sum)).sum();
        let (l1, depth) = (mean(colour, 3 * pixels), mean(deep, samples));
        let ssim = (centres > 0).then(|| similar / (3 * centres) as f64);
        let LossWeights { l1: of_l1, ssim: of_ssim, depth: of_depth, .. } = self.weights;
        let total = f64::from(of_l1) * l1
            + ssim.map_or(0.0, |ssim| f64::from(of_ssim) * (1.0 - ssim))
            + f64::from(of_depth) * depth;
        LossTerms { l1, ssim, depth, total }
    }
}

/// Adds what each Gaussian does to the costs of a view, drawn through what is opaque, to `[N, 4]` effects: those of [`pixel_costs`], with `by_square` of
/// what an absolute error costs for its square.
///
/// # Errors
/// Where the GPU has not so much room.
///
/// [`pixel_costs`]: super::pixel_costs
pub(crate) fn add_effects<'v>(
    work: &mut Work<'_>,
    (view, drawn): (&'v View, &Drawn),
    (weights, by_square): (&LossWeights, f32),
    kept: &mut Kept<'v>,
    effects: &Buffer,
) -> Result<(), GpuError> {
    // The similarity alone counts as linear.
    let linear = LossSums::new(work, &[view], &LossWeights { l1: 0.0, depth: 0.0, ..*weights })?;
    let truth = linear.truth(work, 0, view, kept)?;
    let slopes = linear.gradient(work, &truth, drawn)?;
    let LossCounts { pixels, samples, .. } = truth.view.counts;
    let colour = over(weights.l1, 3 * pixels);
    let per = [colour, by_square * colour, over(weights.depth, samples)];
    work.add_effects(drawn, ViewCosts { truth: &truth.pixels, slopes: &slopes, per }, effects)
}

/// As [`residual_image`](super::residual_image), with maps of the pixels that count and of their mean absolute errors.
///
/// # Errors
/// Where the GPU has not so much room.
pub(crate) fn residual(work: &mut Work<'_>, truth: &Truth, drawn: &Drawn) -> Result<Buffer, GpuError> {
    let gradients = pixel_gradients(work, truth)?;
    let bindings = [(1, &truth.pixels), (2, &drawn.image), (3, &drawn.ends), (5, &gradients)];
    work.run(&TAKE_RESIDUAL, &[&truth.pair], &bindings, groups_over(to_u32(truth.num_pixels)));
    Ok(gradients)
}

/// `[H, W, 4]` of `[H, W, 3]` colours before a step.
///
/// # Errors
/// Where the GPU has not so much room.
pub(crate) fn colours_before(work: &mut Work<'_>, image: &[f32]) -> Result<Buffer, GpuError> {
    work.upload("colours before", &in_fours(image))
}

/// Maps of what is wanted of a step times what it does to the colours `before` (`[H, W, 4]`), and of the square of the latter.
///
/// # Errors
/// Where the GPU has not so much room.
pub(crate) fn agreement(
    work: &mut Work<'_>,
    truth: &Truth,
    drawn: &Drawn,
    before: &Buffer,
) -> Result<Buffer, GpuError> {
    let gradients = pixel_gradients(work, truth)?;
    let bindings = [(1, &truth.pixels), (2, &drawn.image), (4, before), (5, &gradients)];
    work.run(&TAKE_AGREEMENT, &[&truth.pair], &bindings, groups_over(to_u32(truth.num_pixels)));
    Ok(gradients)
}

fn over(weight: f32, count: usize) -> f32 {
    if count == 0 { 0.0 } else { weight / count as f32 }
}

fn pixel_gradients(work: &mut Work<'_>, truth: &Truth) -> Result<Buffer, GpuError> {
    work.buffer::<[f32; PIXEL_GRADIENT]>("gradients of pixels", truth.num_pixels)
}

/// `[H, W, 4]` true colours; `LiDAR` depth, 0 where there is none, -1 where the pixel is ignored.
pub(super) fn packed(view: &View) -> Vec<[f32; 4]> {
    let mut pixels = in_fours(&view.image.data);
    view.depth_samples.iter().for_each(|sample| pixels[sample.pixel as usize][3] = sample.depth);
    if let Some(labels) = &view.labels {
        let ignored = pixels.iter_mut().zip(labels).filter(|(_, label)| **label == PixelLabel::Ignored);
        ignored.for_each(|(pixel, _)| pixel[3] = -1.0);
    }
    pixels
}

/// `[H, W, 4]` of `[H, W, 3]` colours, the fourth 0.
fn in_fours(image: &[f32]) -> Vec<[f32; 4]> {
    image.as_chunks::<3>().0.par_iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect()
}

fn similarity_constants() -> String {
    let weights = window();
    let mut text = single("C1", C1) + &single("C2", C2);
    text += "fn window(k: u32) -> f32 {\n    switch (k) {\n";
    for (k, weight) in weights.iter().enumerate().take(WINDOW - 1) {
        text += &format!("        case {k}u: {{ return {weight:?}f; }}\n");
    }
    text + &format!("        default: {{ return {:?}f; }}\n    }}\n}}\n", weights[WINDOW - 1])
}
