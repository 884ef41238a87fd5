//! How far every Gaussian goes along its step: as far as the images around it ask.

#[cfg(feature = "gpu")]
mod gpu;

use std::borrow::Cow;

use lgs_formats::casts::to_f32;
use rayon::prelude::*;

use crate::gaussians::physical::{Splat, to_physical};
use crate::gaussians::{GaussianSet, MEAN};
use crate::loss::{Kept, counted_pixels};
use crate::network::normalise::is_carried_away;
use crate::objective::BEHIND;
use crate::parallel;
use crate::render::{Device, blended_sums, render, render_for_gradient};
use crate::views::View;

/// Shortest and longest step, of the one that the network asks for.
const LENGTHS: [f64; 2] = [0.5, 2.0];
/// Share of the usual change under a Gaussian with which it is taken for granted that the network is right.
const PRIOR: f64 = 0.1;
/// Gaussians that a thread takes at once.
const GRAIN: usize = 4096;

/// Lengths of the steps that led to `after`, in units of the step; 1 for a Gaussian that no view shows.
///
/// # Shapes
/// `before` is `[H, W, 3]` for each of `views`: the colours before the step; result `[N]`.
///
/// # Formula
/// `(sum w r d + p) / (sum w d d + p)`, within 0.5..=2, over the pixels and channels of all views: w the blending weight of the Gaussian after
/// the step, r = truth - before, d = after - before, p a tenth of the mean of `sum w d d` over the Gaussians that are shown. Where the colours
/// around a Gaussian change in proportion to its step, that is the least squared error.
pub fn step_lengths(device: Device, before: &[Vec<f32>], after: &GaussianSet, views: &[&View]) -> Vec<f32> {
    let before = Before { images: before, scene: &GaussianSet::default() };
    step_lengths_with(device, before, after, views, &mut Kept::default())
}

/// What views showed before a step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Before<'a> {
    /// `[H, W, 3]` of each view; empty where they stay on the GPU.
    pub(super) images: &'a [Vec<f32>],
    /// The scene, for images that the GPU has lost.
    pub(super) scene: &'a GaussianSet,
}

/// As [`step_lengths`], with what is kept of the views on a GPU.
pub(super) fn step_lengths_with<'v>(
    device: Device,
    before: Before<'_>,
    after: &GaussianSet,
    views: &[&'v View],
    kept: &mut Kept<'v>,
) -> Vec<f32> {
    let sums = agreements_on(device, before, &to_physical(after), views, kept);
    let (count, total) = sums.iter().fold((0, 0.0), |(count, total), [_, change]| match *change > 0.0 {
        true => (count + 1, total + change),
        false => (count, total),
    });
    let prior = PRIOR * total / f64::from(count.max(1));
    let length = |[agree, change]: &[f64; 2]| {
        let length = (agree + prior) / (change + prior);
        if length.is_finite() { to_f32(length.clamp(LENGTHS[0], LENGTHS[1])) } else { 1.0 }
    };
    parallel::map(sums.len(), GRAIN, &|i| length(&sums[i]))
}

/// `[N]` sums over the views of the maps of [`agreement`] under the weights of every Gaussian.
fn agreements_on<'v>(
    device: Device,
    before: Before<'_>,
    splats: &[Splat],
    views: &[&'v View],
    kept: &mut Kept<'v>,
) -> Vec<[f64; 2]> {
    #[cfg(feature = "gpu")]
    if let Some(sums) = device.try_gpu(|gpu| gpu::agreements(gpu, before.images, splats, views, kept)) {
        return sums;
    }
    // Without GPUs there is one device.
    let _ = (device, kept);
    let mut sums = vec![[0.0_f64; 2]; splats.len()];
    let redrawn = if before.images.is_empty() { to_physical(before.scene) } else { Vec::new() };
    for (number, view) in views.iter().enumerate() {
        let before = match before.images.get(number) {
            Some(image) => Cow::Borrowed(image),
            None => Cow::Owned(render(&redrawn, &view.pinhole, BEHIND).rgb),
        };
        let state = render_for_gradient(splats, &view.pinhole, BEHIND);
        let maps = agreement(&before, &state.images.rgb, view);
        let of_visible = blended_sums::<2>(&state, &[&maps[0], &maps[1]]);
        state.places(splats.len()).each(&mut sums, |[agree, change], place| {
            *agree += of_visible[place][0];
            *change += of_visible[place][1];
        });
    }
    sums
}

/// `[H, W]` of a view: the product of what is wanted and what the step does, and the square of the latter; 0 where the pixel is ignored.
fn agreement(before: &[f32], after: &[f32], view: &View) -> [Vec<f32>; 2] {
    let truth = &view.image.data;
    let pixel_sums = |(pixel, counts): (usize, f32)| {
        let mut sums = (0.0, 0.0);
        for k in 3 * pixel..3 * pixel + 3 {
            let change = after[k] - before[k];
            sums.0 += counts * (truth[k] - before[k]) * change;
            sums.1 += counts * change * change;
        }
        sums
    };
    let (agree, change) = counted_pixels(view).into_par_iter().enumerate().map(pixel_sums).unzip();
    [agree, change]
}

/// Makes the steps from `before` to `set` so long; one that would end nowhere stays as it is.
///
/// # Shapes
/// `lengths` `[N]`.
pub fn lengthen(set: &mut GaussianSet, before: &GaussianSet, lengths: &[f32]) {
    parallel::for_each_pair(&mut set.attributes, &mut set.velocities, GRAIN, &|i, set_row, set_velocity| {
        let (old, old_velocity, length) = (&before.attributes[i], &before.velocities[i], lengths[i]);
        let (mut row, mut velocity) = (*set_row, *set_velocity);
        row.iter_mut().zip(old).for_each(|(new, old)| *new = (*new - old).mul_add(length, *old));
        velocity.iter_mut().zip(old_velocity).for_each(|(new, old)| *new = (*new - old).mul_add(length, *old));
        if row.iter().chain(&velocity).all(|value| value.is_finite()) && !is_carried_away(&old[MEAN], &row[MEAN]) {
            (*set_row, *set_velocity) = (row, velocity);
        }
    });
}

#[cfg(test)]
mod tests {
    use lgs_formats::image::PixelLabel;

    use super::{lengthen, step_lengths};
    use crate::gaussians::physical::{logit, to_physical};
    use crate::gaussians::{GaussianSet, LOGIT_COLOUR, MEAN};
    use crate::objective::BEHIND;
    use crate::render::{Device, render_for_gradient};
    use crate::views::{
        PinholeView, View,
        samples::{ahead, seen},
    };

    const WIDTH: usize = 32;

    /// Two Gaussians of these greys, left and right, and one behind the camera.
    fn scene(left: f32, right: f32) -> GaussianSet {
        let row = |x: f32, z: f32, grey: f32| {
            let mut row = [x, 0.0, z, 1.0, 0.0, 0.0, 0.0, -1.5, -1.5, -1.5, 4.0, 0.0, 0.0, 0.0];
            row[LOGIT_COLOUR].fill(logit(grey));
            row
        };
        let attributes = vec![row(-1.0, 4.0, left), row(1.0, 4.0, right), row(0.0, -4.0, 0.5)];
        GaussianSet { attributes, times: vec![0.0; 3], frames: vec![0; 3], velocities: vec![[0.0; 3]; 3], num_lidar: 3 }
    }

    fn drawn(set: &GaussianSet, pinhole: &PinholeView) -> Vec<f32> {
        render_for_gradient(&to_physical(set), pinhole, BEHIND).images.rgb
    }

    /// A view whose image is that of `truth`.
    fn view(truth: &GaussianSet) -> View {
        let pinhole = ahead(WIDTH, WIDTH, 32.0);
        let data = drawn(truth, &pinhole);
        seen(pinhole, data)
    }

    #[test]
    fn every_gaussian_goes_as_far_as_its_images_ask() {
        let (before, after) = (scene(0.2, 0.2), scene(0.4, 0.4));
        let mut view = view(&scene(0.5, 0.3));
        let lengths = |view: &View| step_lengths(Device::Cpu, &[drawn(&before, &view.pinhole)], &after, &[view]);
        let found = lengths(&view);
        // Colours are wanted to change by 0.3 and 0.1 where the step changes them by 0.2; a tenth of the usual change speaks for 1.
        assert!((found[0] - 16.0 / 11.0).abs() < 0.02 && (found[1] - 6.0 / 11.0).abs() < 0.02, "{found:?}");
        assert_eq!(found[2].to_bits(), 1.0_f32.to_bits(), "not shown");
        let left = |pixel: usize| pixel % WIDTH < WIDTH / 2;
        let label = |pixel| if left(pixel) { PixelLabel::Ignored } else { PixelLabel::Static };
        view.labels = Some((0..WIDTH * WIDTH).map(label).collect());
        let found = lengths(&view);
        assert!((found[0] - 1.0).abs() < 1e-6 && found[1] < 0.6, "ignored pixels ask for nothing: {found:?}");
    }

    #[test]
    fn lengths_are_bounded_and_finite() {
        let (before, same) = (scene(0.2, 0.2), scene(0.2, 0.2));
        let lengths = |truth: &GaussianSet, after: &GaussianSet| {
            let view = view(truth);
            step_lengths(Device::Cpu, &[drawn(&before, &view.pinhole)], after, &[&view])
        };
        assert_eq!(lengths(&scene(0.9, 0.9), &same), [1.0; 3], "nothing changed");
        assert_eq!(lengths(&scene(0.9, 0.05), &scene(0.21, 0.21))[..2], [2.0, 0.5]);
        let mut view = view(&before);
        view.image.data.fill(f32::NAN);
        assert_eq!(step_lengths(Device::Cpu, &[drawn(&before, &view.pinhole)], &scene(0.4, 0.4), &[&view]), [1.0; 3]);
        assert_eq!(step_lengths(Device::Cpu, &[], &before, &[]), [1.0; 3]);
    }

    #[test]
    fn steps_that_would_end_nowhere_keep_their_length() {
        let before = scene(0.2, 0.2);
        let mut after = scene(0.4, 0.4);
        after.attributes[1][MEAN.start] = 3e38;
        after.attributes[2][MEAN.start] = 9e3;
        let kept = after.clone();
        lengthen(&mut after, &before, &[0.5, 2.0, 2.0]);
        let colour = LOGIT_COLOUR.start;
        let half = (before.attributes[0][colour] + kept.attributes[0][colour]) / 2.0;
        assert!((after.attributes[0][colour] - half).abs() < 1e-6);
        assert_eq!((after.attributes[1], after.attributes[2]), (kept.attributes[1], kept.attributes[2]));
    }
}
