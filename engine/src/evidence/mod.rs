//! What the input views show of every Gaussian: what taking it out would cost, and what its halves could gain.

#[cfg(feature = "gpu")]
mod gpu;
mod rounds;
#[cfg(test)]
pub(crate) mod samples;

use crate::gaussians::GaussianSet;
use crate::gaussians::physical::{Splat, to_physical};
use crate::loss::{LossWeights, pixel_costs};
use crate::objective::BEHIND;
use crate::parallel;
use crate::render::constants::{HARDLY_SEEN, UNSEEN};
use crate::render::{Device, Effect, PixelCosts, Projection, effects, halving, longest_axes};
use crate::views::View;

pub use rounds::{keep, num_rounds, survivors};

/// How many of the pixels that hide a Gaussian from the input views show it in views between them, as far as a prior can tell. Held-out PSNR of
/// half the Gaussians after three learned steps, on the front cameras of two data sets: 22.55 and 29.11 dB at 0, 22.90 and 29.19 at 0.1, 22.86 and
/// 29.19 at 0.3, 22.76 and 29.05 at 1.
const UNHIDDEN: f64 = 0.2;
/// How much more than an absolute error the square of one counts where Gaussians are to go. The loss mends no spot that has lost much: of all that
/// pruning costs, most lies in one pixel of a hundred. Held-out PSNR of four clips, the mean, of 70 % of the scene at 0, 10, 30, 100, 300 and 1000, a
/// step ahead: 25.92, 25.99, 26.03, 26.07, 26.08 and 26.07 dB; without the loss beside them depth errors grow by 6 %.
const SQUARES: f32 = 100.0;
/// Keeps a division defined where a Gaussian shows hardly a pixel: a square of blending weights, pixels.
const FAINT: f64 = 0.05;
/// Gaussians that a thread takes at once.
const GRAIN: usize = 4096;

/// What the views show.
#[derive(Clone, Debug, Default)]
pub struct Evidence {
    /// `[N]` sums over the views.
    pub effects: Vec<Effect>,
    /// `[N]` the axis along which each is split; empty where halves were not asked for.
    pub axes: Vec<u8>,
    /// Mean loss over the views.
    pub loss: f64,
    /// Squared error of a pixel's three channels, the mean over all pixels that take part.
    pub squared_error: f64,
}

/// What a change of a picture costs.
#[derive(Clone, Copy, Debug)]
struct Pricing<'a> {
    weights: &'a LossWeights,
    /// How much more squared errors count than absolute ones.
    by_square: f32,
    /// Transmittance down to which pixels are composited.
    least: f32,
}

impl Evidence {
    /// That of a scene in its input views: removals by the mean loss over them, the rest as sums over their pixels.
    ///
    /// # Formula
    /// That of [`effects`], with the costs of [`pixel_costs`], compositing also what is behind opaque Gaussians.
    pub fn of(set: &GaussianSet, views: &[&View], weights: &LossWeights) -> Self {
        let splats = to_physical(set);
        let pinholes: Vec<_> = views.iter().map(|view| &view.pinhole).collect();
        let axes = longest_axes(&splats, &pinholes);
        Self::seen(&splats, axes, views, Pricing { weights, by_square: 0.0, least: UNSEEN })
    }

    /// `[N]` what pruning needs: [`Evidence::costs`] by the loss and the squared errors of colours, measured where views are drawn.
    ///
    /// # Formula
    /// That of [`effects`], `per_square = 100 per_colour`.
    pub fn removal_costs(device: Device, set: &GaussianSet, views: &[&View], weights: &LossWeights) -> Vec<f64> {
        let splats = to_physical(set);
        #[cfg(feature = "gpu")]
        if let Some(effects) = device.try_gpu(|gpu| gpu::effects(gpu, &splats, views, (weights, SQUARES))) {
            return Self { effects, ..Self::default() }.costs();
        }
        // Without GPUs there is one device.
        let _ = device;
        let pricing = Pricing { weights, by_square: SQUARES, least: HARDLY_SEEN };
        Self::seen(&splats, Vec::new(), views, pricing).costs()
    }

    /// What the views show of the halves along the axes, or without axes, of no halves.
    fn seen(splats: &[Splat], axes: Vec<u8>, views: &[&View], pricing: Pricing<'_>) -> Self {
        let Pricing { weights, by_square, least } = pricing;
        let mut all: Vec<Effect> = parallel::map(splats.len(), GRAIN, &|_| Effect::default());
        let (mut loss, mut squares, mut pixels) = (0.0, 0.0, 0.0);
        for view in views {
            let state = Projection::new(splats, &view.pinhole).render_through(&view.pinhole, BEHIND, least);
            let costs = pixel_costs(&state.images, view, weights);
            let costs = PixelCosts { per_square: by_square * costs.per_colour, ..costs };
            let halving = (!axes.is_empty()).then(|| halving(splats, &axes, &view.pinhole, &state));
            // The sums are of a fixed order, and so of one thread, beside all else.
            let sums = || {
                let squares = costs.residual.iter().map(|&r| f64::from(r).powi(2)).sum::<f64>();
                (squares, costs.counted.iter().map(|&counted| f64::from(counted)).sum::<f64>())
            };
            let (of_view, of_pixels) = rayon::join(|| effects(&state, &costs, halving.as_deref()), sums);
            (loss, squares, pixels) = (loss + costs.loss, squares + of_pixels.0, pixels + of_pixels.1);
            state.places(splats.len()).each(&mut all, |sum, place| sum.add(&of_view[place]));
        }
        let share = 1.0 / views.len().max(1) as f64;
        parallel::for_chunks(&mut all, GRAIN, &|_, part| part.iter_mut().for_each(|effect| effect.removal *= share));
        let squared_error = if pixels > 0.0 { squares / pixels } else { 0.0 };
        Self { effects: all, axes, loss: loss * share, squared_error }
    }

    /// `[N]` what each costs to take out: what the input views say, and for what hides it there the mean of what is shown.
    ///
    /// # Formula
    /// `removal + 0.2 m sum_p (alpha - w)`, `m` the sum of all positive removals over the pixels that all Gaussians show.
    pub fn costs(&self) -> Vec<f64> {
        let sum = |of: fn(&Effect) -> f64| self.effects.iter().map(of).sum::<f64>();
        let shown = sum(|effect| effect.shown);
        let mean = if shown > 0.0 { sum(|effect| effect.removal.max(0.0)) / shown } else { 0.0 };
        let cost = |effect: &Effect| effect.removal + UNHIDDEN * mean * (effect.covered - effect.shown);
        parallel::map(self.effects.len(), GRAIN, &|i| cost(&self.effects[i]))
    }

    /// `[N]` by how much the squared errors fall when the colours of the halves of each are fitted to them, beyond what a fit of its own colour
    /// brings.
    ///
    /// # Formula
    /// By channel `v^T M^-1 v - (v_1 + v_2)^2 / sum w^2`, `v_k = sum w_k r` of the halves' weights, `M_kl = sum w_k w_l`.
    pub fn gains(&self) -> Vec<f64> {
        self.effects.iter().map(gain).collect()
    }
}

fn gain(effect: &Effect) -> f64 {
    let [aa, a_whole, whole] = effect.squares;
    let (ab, bb) = (a_whole - aa, whole - 2.0 * a_whole + aa);
    let (aa, bb) = (aa + FAINT, bb + FAINT);
    let determinant = aa * bb - ab * ab;
    (0..3)
        .map(|c| {
            let (a, b) = (effect.half[c], effect.whole[c] - effect.half[c]);
            let halves = (bb * a * a - 2.0 * ab * a * b + aa * b * b) / determinant;
            (halves - effect.whole[c].powi(2) / (whole + FAINT)).max(0.0)
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::samples::{scene, view};
    use super::*;
    use crate::render::Rendered;

    /// What the costs say of a picture in place of another, pixel by pixel.
    fn change(costs: &PixelCosts, before: &Rendered, after: &Rendered) -> f64 {
        let expected = [before, after].map(Rendered::expected_depth);
        (0..before.alpha.len())
            .map(|p| {
                let colours = (3 * p..3 * p + 3).map(|k| {
                    let (old, step) = (f64::from(costs.residual[k]), f64::from(after.rgb[k] - before.rgb[k]));
                    let size = f64::from(costs.per_colour * costs.counted[p]) * ((old + step).abs() - old.abs());
                    let square = f64::from(costs.per_square * costs.counted[p]) * (2.0 * old + step) * step;
                    size + square + f64::from(costs.slopes[k]) * step
                });
                let error = |depth: f32| f64::from((depth - costs.depth[p]).abs());
                let depth = if costs.depth[p] > 0.0 { error(expected[1][p]) - error(expected[0][p]) } else { 0.0 };
                colours.sum::<f64>() + f64::from(costs.per_depth) * depth
            })
            .sum()
    }

    #[test]
    fn removals_are_the_same_without_halves() {
        let (set, view, weights) = (scene(0.0), view(), LossWeights::default());
        let with = Evidence::of(&set, &[&view], &weights);
        let pricing = Pricing { weights: &weights, by_square: 0.0, least: UNSEEN };
        let without = Evidence::seen(&to_physical(&set), Vec::new(), &[&view], pricing);
        assert_eq!((with.costs(), with.loss), (without.costs(), without.loss));
        assert!(without.effects.iter().all(|effect| effect.squares == [0.0; 3]) && without.axes.is_empty());
    }

    /// Taken out one by one, at opacities at which nothing ends a pixel and at which pixels are opaque many times over.
    #[test]
    fn a_removal_is_what_the_picture_without_it_costs() {
        let view = view();
        for (opacity, squares) in [(-1.0, 0.0), (6.0, 0.0), (-1.0, SQUARES), (6.0, SQUARES)] {
            let set = scene(opacity);
            let splats = to_physical(&set);
            let base = Projection::new(&splats, &view.pinhole);
            let state = base.clone().render_through(&view.pinhole, BEHIND, UNSEEN);
            let costs = pixel_costs(&state.images, &view, &LossWeights::default());
            let costs = PixelCosts { per_square: squares * costs.per_colour, ..costs };
            let pricing = Pricing { weights: &LossWeights::default(), by_square: squares, least: UNSEEN };
            let found = Evidence::seen(&splats, Vec::new(), &[&view], pricing);
            let mut largest = 0.0_f64;
            for i in 0..set.len() {
                let gone: Vec<bool> = (0..set.len()).map(|k| k == i).collect();
                let without = base.without(&gone).render_through(&view.pinhole, BEHIND, UNSEEN);
                let want = change(&costs, &state.images, &without.images);
                let got = found.effects[i].removal;
                assert!((got - want).abs() < 1e-6 + 1e-4 * want.abs(), "Gaussian {i}: {got} {want}");
                largest = largest.max(want.abs());
            }
            assert!(largest > 1e-4, "{largest}");
        }
    }
}
