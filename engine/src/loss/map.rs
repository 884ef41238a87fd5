//! The image loss, pixel by pixel, and what a change of a few pixels does to it.

use std::borrow::Cow;

use lgs_formats::casts::to_f32;
use lgs_formats::image::PixelLabel;
use rayon::prelude::*;

use super::ssim::{ImagePair, SimilarityMap, similarity_map};
use super::{GRAIN, LossWeights, depth_errors, fill_ignored, has_ignored};
use crate::render::{Patch, Rendered, crop};
use crate::views::View;

/// Half a similarity window: a centre sees so many pixels to each side.
const REACH: usize = 5;

/// What each term of a view's loss is a mean over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LossCounts {
    /// Pixels that are not ignored.
    pub(super) pixels: usize,
    /// Window centres of the similarity that are not ignored.
    pub(super) centres: usize,
    /// Depth samples whose pixel is not ignored.
    pub(super) samples: usize,
}

/// The loss of one rendered view as a map.
#[derive(Clone, Debug, PartialEq)]
pub struct LossMap {
    /// `[H, W]` values whose mean is the loss.
    pub values: Vec<f32>,
    /// The loss.
    pub total: f64,
}

fn is_ignored(view: &View, pixel: usize) -> bool {
    view.labels.as_ref().is_some_and(|labels| labels[pixel] == PixelLabel::Ignored)
}

impl LossCounts {
    /// The counts of a view.
    pub fn of(view: &View) -> Self {
        let (width, height) = (view.pinhole.width, view.pinhole.height);
        let kept = |pixel: &usize| !is_ignored(view, *pixel);
        let inside = |pixel: &usize| {
            let (x, y) = (pixel % width, pixel / width);
            x >= REACH && x + REACH < width && y >= REACH && y + REACH < height
        };
        let pixels = || (0..width * height).into_par_iter().with_min_len(GRAIN);
        Self {
            pixels: pixels().filter(kept).count(),
            centres: pixels().filter(kept).filter(inside).count(),
            samples: view.depth_samples.iter().filter(|s| kept(&(s.pixel as usize))).count(),
        }
    }

    /// Loss by the sums of absolute colour errors and of `1 - similarity` over the channels, and of absolute depth errors.
    pub(super) fn loss(&self, weights: &LossWeights, [colour, dissimilarity, depth]: [f64; 3]) -> f64 {
        let mean =
            |weight: f32, sum: f64, count: usize| if count == 0 { 0.0 } else { f64::from(weight) * sum / count as f64 };
        mean(weights.l1, colour, 3 * self.pixels)
            + mean(weights.ssim, dissimilarity, 3 * self.centres)
            + mean(weights.depth, depth, self.samples)
    }
}

/// The loss of [`image_loss`](super::image_loss) as a map: every term stands at the pixel that it is of, the similarity at its window's
/// centre.
///
/// # Shapes
/// `rendered` has the size of `view`; result `[H, W]`.
///
/// # Formula
/// `values[p] = H W (l1 |error| / (3 pixels) + ssim sum_c (1 - SSIM_c) / (3 centres) + depth |error| / samples)`.
pub fn loss_map(rendered: &Rendered, view: &View, weights: &LossWeights, counts: &LossCounts) -> LossMap {
    let (width, height) = (rendered.width, rendered.height);
    let colours = visible_colours(&rendered.rgb, view);
    let pair = ImagePair { truth: &view.image.data, rendered: &colours, width, height };
    let scale = (width * height) as f64;
    let unit = |sums: [f64; 3]| to_f32(scale * counts.loss(weights, sums));
    let [per_colour, per_similarity, per_depth] = [unit([1.0, 0.0, 0.0]), unit([0.0, 1.0, 0.0]), unit([0.0, 0.0, 1.0])];
    let error = |(r, t): (&[f32], &[f32])| r.iter().zip(t).map(|(r, t)| (r - t).abs()).sum::<f32>() * per_colour;
    let mut values: Vec<f32> = colours.chunks_exact(3).zip(pair.truth.chunks_exact(3)).map(error).collect();
    if let Some(map) = similarity_map(&pair).filter(|_| counts.centres > 0) {
        for (i, similarity) in map.values.chunks_exact(3).enumerate() {
            let pixel = (i / map.width + REACH) * width + i % map.width + REACH;
            if !is_ignored(view, pixel) {
                values[pixel] += per_similarity * similarity.iter().map(|s| 1.0 - s).sum::<f32>();
            }
        }
    }
    for (pixel, error) in depth_errors(rendered, &view.depth_samples, view.labels.as_deref()) {
        values[pixel] += per_depth * error.abs();
    }
    let total = values.iter().map(|&v| f64::from(v)).sum::<f64>() / scale.max(1.0);
    LossMap { values, total }
}

/// By how much the loss of a view changes when a patch of its rendered images does.
///
/// # Formula
/// The difference of the two losses, from the terms alone that see a pixel of the patch.
pub fn patch_change(
    rendered: &Rendered,
    patch: &Patch,
    view: &View,
    weights: &LossWeights,
    counts: &LossCounts,
) -> f64 {
    let around = Around::of(patch, rendered);
    let before = crop(rendered, around.corner, around.size);
    let mut after = before.clone();
    around.paste(&mut after, patch);
    let seen = around.view(view);
    let sums = |images: &Rendered| {
        let colours = visible_colours(&images.rgb, &seen);
        let pair =
            ImagePair { truth: &seen.image.data, rendered: &colours, width: images.width, height: images.height };
        let errors = colours.iter().zip(pair.truth).map(|(r, t)| f64::from((r - t).abs()));
        let depths = depth_errors(images, &seen.depth_samples, seen.labels.as_deref()).map(|(_, e)| f64::from(e.abs()));
        [errors.sum(), similarity_map(&pair).map_or(0.0, |map| dissimilarity(&map, &seen)), depths.sum()]
    };
    let (old, new) = (sums(&before), sums(&after));
    counts.loss(weights, std::array::from_fn(|k| new[k] - old[k]))
}

/// Sum of `1 - similarity` over the channels of the centres that are not ignored.
fn dissimilarity(map: &SimilarityMap, view: &View) -> f64 {
    let width = map.width + 2 * REACH;
    let of_centre = |(i, similarity): (usize, &[f32])| {
        let pixel = (i / map.width + REACH) * width + i % map.width + REACH;
        if is_ignored(view, pixel) { 0.0 } else { similarity.iter().map(|&s| 1.0 - f64::from(s)).sum::<f64>() }
    };
    map.values.chunks_exact(3).enumerate().map(of_centre).sum()
}

/// The colours with the truth in place of the ignored ones.
fn visible_colours<'a>(rgb: &'a [f32], view: &View) -> Cow<'a, [f32]> {
    match view.labels.as_deref().filter(|labels| has_ignored(labels)) {
        None => Cow::Borrowed(rgb),
        Some(labels) => {
            let mut filled = Vec::new();
            fill_ignored(rgb, &view.image.data, labels, &mut filled);
            Cow::Owned(filled)
        }
    }
}

/// The rectangle of an image whose pixels some similarity window of the patch sees.
struct Around {
    corner: [usize; 2],
    size: [usize; 2],
}

impl Around {
    fn of(patch: &Patch, image: &Rendered) -> Self {
        let sides = [[patch.images.width, image.width], [patch.images.height, image.height]];
        let corner = patch.corner.map(|c| c.saturating_sub(2 * REACH));
        let end = |k: usize| (patch.corner[k] + sides[k][0] + 2 * REACH).min(sides[k][1]);
        Self { corner, size: [0, 1].map(|k| end(k) - corner[k]) }
    }

    fn paste(&self, images: &mut Rendered, patch: &Patch) {
        let [left, top] = [0, 1].map(|k| patch.corner[k] - self.corner[k]);
        let (width, new) = (patch.images.width, &patch.images);
        for y in 0..new.height {
            let (to, from) = ((top + y) * images.width + left, y * width);
            images.rgb[3 * to..3 * (to + width)].copy_from_slice(&new.rgb[3 * from..3 * (from + width)]);
            images.alpha[to..to + width].copy_from_slice(&new.alpha[from..from + width]);
            images.depth[to..to + width].copy_from_slice(&new.depth[from..from + width]);
        }
    }

    /// The part of the view inside the rectangle.
    #[expect(clippy::cast_possible_truncation, reason = "pixels inside a view whose pixels a u32 counts")]
    fn view(&self, view: &View) -> View {
        let ([left, top], [width, height]) = (self.corner, self.size);
        let full = view.pinhole.width;
        let start = |y: usize| (top + y) * full + left;
        let rows = || (0..height).map(|y| start(y)..start(y) + width);
        let mut cut = View {
            frame: view.frame,
            camera: String::new(),
            role: view.role,
            pinhole: view.pinhole,
            image: lgs_formats::image::RgbImage { width, height, data: Vec::with_capacity(3 * width * height) },
            labels: view.labels.as_ref().map(|labels| rows().flat_map(|row| labels[row].iter().copied()).collect()),
            response: None,
            depth_map: None,
            depth_samples: Vec::new(),
        };
        for (y, row) in rows().enumerate() {
            cut.image.data.extend_from_slice(&view.image.data[3 * row.start..3 * row.end]);
            let samples = &view.depth_samples;
            let first = samples.partition_point(|s| (s.pixel as usize) < row.start);
            for sample in samples[first..].iter().take_while(|s| (s.pixel as usize) < row.end) {
                let pixel = (y * width + sample.pixel as usize - row.start) as u32;
                cut.depth_samples.push(crate::views::DepthSample { pixel, depth: sample.depth });
            }
        }
        cut
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gaussians::physical::Splat;
    use crate::loss::image_loss;
    use crate::render::{Redraw, render, render_for_gradient};
    use crate::views::{
        DepthSample,
        samples::{ahead, seen},
    };

    const SIZE: [usize; 2] = [70, 45];

    fn at(i: usize, salt: f32) -> f32 {
        ((i as f32 * 12.9898 + salt).sin() * 43_758.547).rem_euclid(1.0)
    }

    fn view() -> View {
        let [width, height] = SIZE;
        let label = |i: usize| if i % 11 == 3 { PixelLabel::Ignored } else { PixelLabel::Static };
        View {
            labels: Some((0..width * height).map(label).collect()),
            depth_samples: (0..200).map(|k| DepthSample { pixel: 15 * k, depth: 4.0 + at(k as usize, 0.9) }).collect(),
            ..seen(ahead(width, height, 60.0), (0..3 * width * height).map(|i| at(i, 0.3)).collect())
        }
    }

    fn splats() -> Vec<Splat> {
        let splat = |i: usize| Splat {
            mean: [4.0 * at(i, 0.1) - 2.0, 3.0 * at(i, 0.7) - 1.5, 3.0 + 2.0 * at(i, 1.3)],
            quat: [1.0, at(i, 2.0), 0.3, 0.0],
            scale: [0.12, 0.2, 0.1],
            opacity: 0.1 + 0.89 * at(i, 5.0),
            colour: [at(i, 6.0), at(i, 7.0), at(i, 8.0)],
            ..Splat::default()
        };
        (0..150).map(splat).collect()
    }

    #[test]
    fn the_mean_of_the_map_is_the_loss() {
        let (view, weights) = (view(), LossWeights::default());
        let rendered = render(&splats(), &view.pinhole, [0.0; 3]);
        let map = loss_map(&rendered, &view, &weights, &LossCounts::of(&view));
        let want = image_loss(&rendered, &view, &weights).0.total;
        assert!((map.total - want).abs() < 1e-6 * want, "{} {want}", map.total);
        assert_eq!(map.values.len(), SIZE[0] * SIZE[1]);
    }

    #[test]
    fn a_patch_changes_the_loss_as_drawing_everything_again_does() {
        let (view, weights, splats) = (view(), LossWeights::default(), splats());
        let counts = LossCounts::of(&view);
        let state = render_for_gradient(&splats, &view.pinhole, [0.0; 3]);
        let redraw = Redraw::new(&state, &view.pinhole, splats.len());
        let loss = |set: &[Splat]| image_loss(&render(set, &view.pinhole, [0.0; 3]), &view, &weights).0.total;
        let before = loss(&splats);
        let mut changed = 0;
        for i in 0..splats.len() {
            let change = |patch: Option<Patch>| {
                patch.map_or(0.0, |patch| patch_change(&state.images, &patch, &view, &weights, &counts))
            };
            let mut without = splats.clone();
            without.remove(i);
            let mut with = splats.clone();
            with.push(Splat { mean: splats[i].mean.map(|x| x + 0.01), ..splats[i] });
            for (got, set) in [(change(redraw.without(i)), &without), (change(redraw.with(&with[splats.len()])), &with)]
            {
                let want = loss(set) - before;
                assert!((got - want).abs() < 2e-7, "Gaussian {i}: got {got}, want {want}");
                changed += usize::from(got != 0.0);
            }
        }
        assert!(changed > 100, "only {changed} actions changed the loss");
    }
}
