//! Raw parameters to physical values, and the chain rule back.

use super::{Branch, GaussianSet, LOG_SCALE, LOGIT_COLOUR, LOGIT_OPACITY, MEAN, NUM_ATTRIBUTES, QUAT};
use crate::parallel;

/// Smallest physical scale of the `LiDAR` branch, metres (specification, section 4).
pub(crate) const MIN_SCALE: f32 = 1e-4;
/// Largest physical scale of the `LiDAR` branch, metres (specification, section 4).
pub(crate) const MAX_SCALE: f32 = 1.0;
/// Log scales beyond this would overflow a squared f32 scale; only the background branch, which has no upper clamp, can reach it.
const MAX_LOG_SCALE: f32 = 20.0;

/// One Gaussian in physical values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Splat {
    /// Where it stands at `time`, metres, clip frame.
    pub mean: [f32; 3],
    /// Rotation (w, x, y, z), not normalised.
    pub quat: [f32; 4],
    /// Standard deviations along its own axes, metres.
    pub scale: [f32; 3],
    /// Opacity in 0..=1.
    pub opacity: f32,
    /// Colour in 0..=1.
    pub colour: [f32; 3],
    /// Velocity, metres a second.
    pub velocity: [f32; 3],
    /// Moment at which it stands at `mean`, seconds.
    pub time: f32,
}

/// Gradient of a scalar by the physical values of one Gaussian.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SplatGradient {
    /// By the mean.
    pub mean: [f32; 3],
    /// By the unnormalised quaternion.
    pub quat: [f32; 4],
    /// By the linear scale.
    pub scale: [f32; 3],
    /// By the opacity.
    pub opacity: f32,
    /// By the colour.
    pub colour: [f32; 3],
    /// By the velocity.
    pub velocity: [f32; 3],
}

impl SplatGradient {
    /// Adds `factor` times another gradient.
    pub fn add_scaled(&mut self, other: &Self, factor: f32) {
        fn add<const D: usize>(to: &mut [f32; D], from: &[f32; D], factor: f32) {
            to.iter_mut().zip(from).for_each(|(t, f)| *t += factor * f);
        }
        add(&mut self.mean, &other.mean, factor);
        add(&mut self.quat, &other.quat, factor);
        add(&mut self.scale, &other.scale, factor);
        add(&mut self.colour, &other.colour, factor);
        add(&mut self.velocity, &other.velocity, factor);
        self.opacity += factor * other.opacity;
    }
}

/// Physical values of every Gaussian, in the order of the set.
///
/// # Formula
/// `scale = clamp(exp(s), 1e-4, 1)` in the `LiDAR` branch, without the upper clamp in the background; `opacity = sigmoid(a)`,
/// `colour = sigmoid(c)`. The quaternion is passed on; the renderer normalises it.
pub fn to_physical(set: &GaussianSet) -> Vec<Splat> {
    parallel::map(set.len(), 4096, &|i| splat_of(set, i))
}

/// The physical values of Gaussian `i`.
pub(crate) fn splat_of(set: &GaussianSet, i: usize) -> Splat {
    let row = &set.attributes[i];
    Splat {
        mean: set.mean(i),
        quat: std::array::from_fn(|k| row[QUAT.start + k]),
        scale: std::array::from_fn(|k| scale_of(row[LOG_SCALE.start + k], set.branch_of(i))),
        opacity: sigmoid(row[LOGIT_OPACITY]),
        colour: std::array::from_fn(|k| sigmoid(row[LOGIT_COLOUR.start + k])),
        velocity: set.velocities[i],
        time: set.times[i],
    }
}

/// Gradients by the raw parameters, and by the velocity, from gradients by the physical values.
///
/// # Shapes
/// Result `[N, 14]` and `[N, 3]`.
///
/// # Gradient
/// `d scale / d s = scale` inside the clamp and 0 outside; `d sigmoid(x) / dx = y (1 - y)`.
pub fn to_raw_gradient(set: &GaussianSet, physical: &[SplatGradient]) -> (Vec<[f32; NUM_ATTRIBUTES]>, Vec<[f32; 3]>) {
    let attributes = parallel::map(physical.len(), 4096, &|i| raw_gradient_of(set, i, &physical[i]));
    (attributes, parallel::map(physical.len(), 4096, &|i| physical[i].velocity))
}

fn raw_gradient_of(set: &GaussianSet, i: usize, g: &SplatGradient) -> [f32; NUM_ATTRIBUTES] {
    let row = &set.attributes[i];
    let mut out = [0.0; NUM_ATTRIBUTES];
    out[MEAN].copy_from_slice(&g.mean);
    out[QUAT].copy_from_slice(&g.quat);
    for k in 0..3 {
        let s = row[LOG_SCALE.start + k];
        let scale = scale_of(s, set.branch_of(i));
        out[LOG_SCALE.start + k] = if s.exp() == scale { g.scale[k] * scale } else { 0.0 };
        let colour = row[LOGIT_COLOUR.start + k];
        out[LOGIT_COLOUR.start + k] = g.colour[k] * sigmoid_slope(colour);
    }
    out[LOGIT_OPACITY] = g.opacity * sigmoid_slope(row[LOGIT_OPACITY]);
    out
}

/// Largest physical scale of the background.
pub(crate) fn most_behind() -> f32 {
    MAX_LOG_SCALE.exp()
}

fn scale_of(log_scale: f32, branch: Branch) -> f32 {
    let upper = match branch {
        Branch::Lidar => MAX_SCALE,
        Branch::Background => most_behind(),
    };
    log_scale.exp().clamp(MIN_SCALE, upper)
}

/// `1 / (1 + exp(-x))`, without overflow at either end.
pub fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

fn sigmoid_slope(x: f32) -> f32 {
    sigmoid(x) * sigmoid(-x)
}

/// The logit of `p`, with `p` kept within 1e-4 of the ends so that the result is finite and can still be moved.
pub fn logit(p: f32) -> f32 {
    let p = p.clamp(1e-4, 1.0 - 1e-4);
    (p / (1.0 - p)).ln()
}
