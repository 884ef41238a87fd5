//! The rendering loss of a scene over several views, and its gradient by the raw parameters.

use std::time::Instant;

use rayon::prelude::*;

use crate::gaussians::physical::{Splat, SplatGradient, to_physical, to_raw_gradient};
use crate::gaussians::{GaussianSet, RawGradient};
use crate::loss::{LossWeights, image_loss, velocity_loss};
use crate::render::{backward, render_for_gradient};
use crate::views::View;

/// Colour behind all Gaussians.
const BEHIND: [f32; 3] = [0.0; 3];

/// Seconds that an objective took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObjectiveSeconds {
    /// Drawing the views, and its gradient.
    pub render: f64,
    /// The loss of the drawn images, and its gradient.
    pub loss: f64,
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
    /// By the raw parameters.
    pub gradient: RawGradient,
    /// `[N]` whether any view shows the Gaussian's footprint.
    pub seen: Vec<bool>,
    /// What it took.
    pub seconds: ObjectiveSeconds,
}

/// The loss of the scene over `views`, and its gradient.
///
/// # Formula
/// `1/V sum_v L(v) + velocity term` with the weights of [`LossWeights`].
///
/// # Gradient
/// Exact, by all 14 raw attributes and the velocities of both branches; views are added in their order.
pub fn objective(set: &GaussianSet, views: &[&View], weights: &LossWeights) -> Objective {
    let start = Instant::now();
    let splats: Vec<Splat> = to_physical(set);
    let mut sum = vec![SplatGradient::default(); splats.len()];
    let mut seen = vec![false; splats.len()];
    let (mut loss, mut terms, mut loss_s) = (0.0, Terms::default(), 0.0);
    let share = 1.0 / views.len().max(1) as f32;
    for view in views {
        let state = render_for_gradient(&splats, &view.pinhole, BEHIND);
        let before_loss = Instant::now();
        let (of_view, by_image) = image_loss(&state.images, view, weights);
        loss_s += before_loss.elapsed().as_secs_f64();
        let mean = 1.0 / views.len() as f64;
        loss += of_view.total * mean;
        terms.l1 += of_view.l1 * mean;
        terms.dissimilarity += of_view.ssim.map_or(0.0, |ssim| 1.0 - ssim) * mean;
        terms.depth += of_view.depth * mean;
        state.visible().for_each(|i| seen[i] = true);
        let gradient = backward(&splats, &view.pinhole, &state, &by_image);
        sum.par_iter_mut().zip(&gradient).with_min_len(4096).for_each(|(s, g)| s.add_scaled(g, share));
    }
    let (attributes, mut velocities) = to_raw_gradient(set, &sum);
    // The background does not move: its velocities are no variables.
    let (speed, by_velocity) = velocity_loss(&set.velocities[..set.num_lidar], weights.velocity);
    for (v, g) in velocities.iter_mut().zip(&by_velocity) {
        v.iter_mut().zip(g).for_each(|(v, g)| *v += g);
    }
    velocities[set.num_lidar..].fill([0.0; 3]);
    loss += speed;
    if weights.velocity > 0.0 {
        terms.speed = speed / f64::from(weights.velocity);
    }
    let seconds = ObjectiveSeconds { render: start.elapsed().as_secs_f64() - loss_s, loss: loss_s };
    Objective { loss, terms, gradient: RawGradient { attributes, velocities }, seen, seconds }
}
