//! The rendering loss of a scene over several views, and its gradient by the raw parameters.

#[cfg(feature = "gpu")]
pub(crate) mod gpu;

use std::time::Instant;

use lgs_formats::casts::to_f32;

use crate::gaussians::physical::{Splat, SplatGradient, to_physical, to_raw_gradient};
use crate::gaussians::{GaussianSet, MeanResiduals, RawGradient};
use crate::loss::{
    Kept, LossTerms, LossWeights, counted_pixels, image_loss, image_loss_terms, residual_image, velocity_loss,
};
use crate::parallel;
use crate::render::{Device, ImageGradient, Places, backward_visible, backward_with_sums, render_for_gradient};
use crate::views::View;

/// Colour behind all Gaussians.
pub(crate) const BEHIND: [f32; 3] = [0.0; 3];

/// A blending weight below which a Gaussian counts less, pixels.
const FAINT: f64 = 0.05;
/// Gaussians or pixels that a thread takes at once.
const GRAIN: usize = 4096;

/// Seconds that an objective took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObjectiveSeconds {
    /// Drawing the views, and its gradient; with the loss where that is not known by itself.
    pub render: f64,
    /// The loss of the drawn images, and its gradient; `None` on a GPU, which does all of it without a stop that would tell.
    pub loss: Option<f64>,
}

/// The terms of a loss, unweighted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Terms {
    /// Mean absolute colour error.
    pub l1: f64,
    /// `1 - SSIM`; views without a similarity count 0.
    pub dissimilarity: f64,
    /// Mean absolute depth error, metres.
    pub depth: f64,
    /// Mean speed of the `LiDAR` branch, metres a second.
    pub speed: f64,
}

/// A scene's loss with its gradient.
#[derive(Clone, Debug)]
pub struct Objective {
    /// Mean of the image losses over the views plus the velocity term.
    pub loss: f64,
    /// Its terms, the means over the views.
    pub terms: Terms,
    /// By the raw parameters; empty when it was not wanted.
    pub gradient: RawGradient,
    /// Empty when they were not wanted.
    pub mean_residuals: MeanResiduals,
    /// `[H, W, 3]` of each view, as drawn; empty when they were not wanted, or stay on a GPU.
    pub images: Vec<Vec<f32>>,
    /// `[N]` whether any view shows the Gaussian's footprint.
    pub seen: Vec<bool>,
    /// What it took.
    pub seconds: ObjectiveSeconds,
}

/// What is computed beside the loss, and where.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// The loss gradient.
    pub gradient: bool,
    /// What every Gaussian sees of the errors.
    pub mean_residuals: bool,
    /// The drawn colours.
    pub images: bool,
    /// Where the views are drawn.
    pub device: Device,
}

/// The loss of the scene over `views`, and its gradient.
///
/// # Formula
/// `1/V sum_v L(v) + velocity term` with the weights of [`LossWeights`].
///
/// # Gradient
/// Exact, by all 14 raw attributes and the velocities of both branches; views are added in their order.
pub fn objective(set: &GaussianSet, views: &[&View], weights: &LossWeights) -> Objective {
    objective_with(set, views, weights, Wanted { gradient: true, ..Wanted::default() })
}

/// As [`objective`], with what is `wanted` beside the loss.
///
/// # Formula
/// Mean residuals: `sum_p (d q_p / d x) r_p / (sum_p w_p + 0.05)` over the pixels p of all views; q colour and depth, w the blending weight,
/// r the error of the colour and [`residual_image`]'s of the depth. For a colour that is the gradient of half the squared error, over the
/// weight: the mean error under the Gaussian.
pub fn objective_with(set: &GaussianSet, views: &[&View], weights: &LossWeights, wanted: Wanted) -> Objective {
    objective_keeping(set, views, weights, wanted, &mut Kept::default())
}

/// As [`objective_with`], with what is kept of the views on a GPU.
pub(crate) fn objective_keeping<'v>(
    set: &GaussianSet,
    views: &[&'v View],
    weights: &LossWeights,
    wanted: Wanted,
    kept: &mut Kept<'v>,
) -> Objective {
    let splats: Vec<Splat> = to_physical(set);
    let Found { terms: of_views, gradients, residuals, blended, images, seen, seconds } =
        found_on(&splats, views, weights, wanted, kept);
    let (mut loss, mut terms) = mean_over(&of_views);
    let mut gradient = gradients.raw(set);
    // The background does not move: its velocities are no variables.
    let (speed, by_velocity) = velocity_loss(&set.velocities[..set.num_lidar], weights.velocity);
    let moving = by_velocity.len().min(gradient.velocities.len());
    parallel::for_each(&mut gradient.velocities[..moving], GRAIN, &|i, v| {
        v.iter_mut().zip(&by_velocity[i]).for_each(|(v, g)| *v += g);
    });
    loss += speed;
    if weights.velocity > 0.0 {
        terms.speed = speed / f64::from(weights.velocity);
    }
    let mean_residuals = over_weights(residuals.raw(set), &blended);
    Objective { loss, terms, gradient, mean_residuals, images, seen, seconds }
}

/// The mean loss of views, and its terms.
pub(crate) fn mean_over(views: &[LossTerms]) -> (f64, Terms) {
    let (mut loss, mut terms) = (0.0, Terms::default());
    let mean = 1.0 / views.len() as f64;
    for view in views {
        loss += view.total * mean;
        terms.l1 += view.l1 * mean;
        terms.dissimilarity += view.ssim.map_or(0.0, |ssim| 1.0 - ssim) * mean;
        terms.depth += view.depth * mean;
    }
    (loss, terms)
}

/// What the views say of a scene, by physical values.
#[derive(Debug)]
struct Found {
    /// Of each view.
    terms: Vec<LossTerms>,
    /// Of the loss; empty when they were not wanted.
    gradients: Sums,
    /// Of the errors; empty when they were not wanted.
    residuals: Sums,
    /// `[N]` weights and absolute errors under every Gaussian, beside the residuals.
    blended: Vec<[f64; 2]>,
    images: Vec<Vec<f32>>,
    seen: Vec<bool>,
    seconds: ObjectiveSeconds,
}

/// What the views say of a scene, where it is wanted; by the processor, where that has not the room for it.
fn found_on<'v>(
    splats: &[Splat],
    views: &[&'v View],
    weights: &LossWeights,
    wanted: Wanted,
    kept: &mut Kept<'v>,
) -> Found {
    // The GPU has no kernel for the term of the peak signal-to-noise ratio, which training alone knows.
    #[cfg(feature = "gpu")]
    if weights.psnr == 0.0
        && let Some(found) = wanted.device.try_gpu(|on| gpu::found(on, splats, views, weights, wanted, kept))
    {
        return found;
    }
    // Without GPUs nothing is kept.
    let _ = kept;
    found(splats, views, weights, wanted)
}

fn found(splats: &[Splat], views: &[&View], weights: &LossWeights, wanted: Wanted) -> Found {
    let start = Instant::now();
    let mut gradients = Sums::new(if wanted.gradient { splats.len() } else { 0 });
    let mut residuals = Sums::new(if wanted.mean_residuals { splats.len() } else { 0 });
    let mut blended = vec![[0.0_f64; 2]; residuals.0.len()];
    let mut seen = vec![false; splats.len()];
    let (mut terms, mut images, mut loss_s) = (Vec::new(), Vec::new(), 0.0);
    let share = 1.0 / views.len().max(1) as f32;
    for view in views {
        let state = render_for_gradient(splats, &view.pinhole, BEHIND);
        let before_loss = Instant::now();
        let (of_view, by_image) = if wanted.gradient {
            image_loss(&state.images, view, weights)
        } else {
            (image_loss_terms(&state.images, view, weights), ImageGradient::default())
        };
        let residual = wanted.mean_residuals.then(|| residual_image(&state.images, view));
        loss_s += before_loss.elapsed().as_secs_f64();
        terms.push(of_view);
        let places = state.places(splats.len());
        places.each(&mut seen, |seen, _| *seen = true);
        if wanted.gradient {
            gradients.add(&places, &backward_visible(splats, &view.pinhole, &state, &by_image), share);
        }
        if let Some(residual) = residual {
            let maps = [counted_pixels(view), absolute(&residual.rgb)];
            let (by_splat, sums) = backward_with_sums(splats, &view.pinhole, &state, &residual, [&maps[0], &maps[1]]);
            residuals.add(&places, &by_splat, 1.0);
            places.each(&mut blended, |[weight, error], place| {
                *weight += sums[place][0];
                *error += sums[place][1];
            });
        }
        if wanted.images {
            images.push(state.images.rgb);
        }
    }
    let seconds = ObjectiveSeconds { render: start.elapsed().as_secs_f64() - loss_s, loss: Some(loss_s) };
    Found { terms, gradients, residuals, blended, images, seen, seconds }
}

/// Sums over pixels, and those of the weight and of the absolute error, as means under every Gaussian.
fn over_weights(mut gradient: RawGradient, blended: &[[f64; 2]]) -> MeanResiduals {
    parallel::for_each_pair(&mut gradient.attributes, &mut gradient.velocities, GRAIN, &|i, attributes, velocity| {
        let share = to_f32(1.0 / (blended[i][0] + FAINT));
        attributes.iter_mut().chain(velocity).for_each(|value| *value *= share);
    });
    let weights = parallel::map(blended.len(), GRAIN, &|i| to_f32(blended[i][0]));
    let errors = parallel::map(blended.len(), GRAIN, &|i| to_f32(blended[i][1] / (blended[i][0] + FAINT)));
    MeanResiduals { gradient, weights, errors }
}

/// `[H, W]` mean magnitude of the three values of every pixel.
fn absolute(rgb: &[f32]) -> Vec<f32> {
    let pixels = rgb.as_chunks::<3>().0;
    let mut all = vec![0.0; pixels.len()];
    parallel::for_chunks(&mut all, GRAIN, &|number, part| {
        let of_pixel = |[r, g, b]: &[f32; 3]| (r.abs() + g.abs() + b.abs()) / 3.0;
        part.iter_mut().zip(&pixels[number * GRAIN..]).for_each(|(mean, pixel)| *mean = of_pixel(pixel));
    });
    all
}

/// Sums over views by physical values.
#[derive(Debug)]
struct Sums(Vec<SplatGradient>);

impl Sums {
    fn new(len: usize) -> Self {
        Self(parallel::map(len, GRAIN, &|_| SplatGradient::default()))
    }

    /// Adds `factor` times the gradients of what a view shows.
    fn add(&mut self, places: &Places, of_visible: &[SplatGradient], factor: f32) {
        places.each(&mut self.0, |sum, place| sum.add_scaled(&of_visible[place], factor));
    }

    /// By the raw parameters; the background's velocities have none.
    fn raw(&self, set: &GaussianSet) -> RawGradient {
        if self.0.is_empty() {
            return RawGradient::default();
        }
        let (attributes, mut velocities) = to_raw_gradient(set, &self.0);
        velocities[set.num_lidar..].fill([0.0; 3]);
        RawGradient { attributes, velocities }
    }
}
