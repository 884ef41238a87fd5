//! The scene that the sweeps start it with: one Gaussian per coloured return.

use super::{
    Gaussian, GaussianSet, LOG_SCALE, LOGIT_COLOUR, LOGIT_OPACITY, MEAN, NUM_ATTRIBUTES, QUAT,
    physical::{MAX_SCALE, MIN_SCALE, logit},
};
use crate::points::PointCloud;

/// Opacity of a Gaussian before anything was learned (specification, section 4).
const OPACITY: f32 = 0.5;
/// Standard deviation of a Gaussian over the mean distance to its three nearest neighbours.
///
/// At 1, as `Flux4D` starts, neighbours overlap so far that edges blur and near surfaces bleed over far ones. Mean PSNR (dB) of held-out
/// views of two real clips, of three cameras and of one, and their mean depth error (metres): 1: 14.4, 16.5 and 8.4, 2.8; 0.7: 14.9, 17.4 and
/// 5.8, 2.0; 0.5: 15.3, 17.9 and 4.2, 1.6; 0.35: 15.9, 18.2 and 3.3, 1.3; 0.2: 16.2, 18.2 and 2.9, 1.2, but then the static background
/// stands for most of the pixels, moving things included.
const SPACING_SHARE: f32 = 0.35;

/// One Gaussian per point that has a colour, in the order of the cloud; velocity zero.
///
/// # Shapes
/// `colours` `[N, 3]`; `spacing` `[M]` metres, of the points that have a colour, in their order.
///
/// # Formula
/// `x` = point, `s = ln(clamp(0.35 spacing, 1e-4, 1))` on all three axes, `q = 1`, `alpha = logit(0.5)`, `c = logit(colour)`.
///
/// # Source
/// `Flux4D`, initial values of its `LiDAR` branch; the random rotation left out.
pub fn initial(cloud: &PointCloud, colours: &[Option<[f32; 3]>], spacing: &[f32]) -> GaussianSet {
    let mut set = GaussianSet::default();
    let painted = colours.iter().enumerate().filter_map(|(i, colour)| Some((i, (*colour)?)));
    for ((i, colour), spacing) in painted.zip(spacing) {
        let scale = (SPACING_SHARE * spacing).clamp(MIN_SCALE, MAX_SCALE);
        let attributes = row(cloud.positions[i], scale, OPACITY, colour);
        set.push(Gaussian { attributes, time: cloud.times[i], frame: cloud.frames[i], velocity: [0.0; 3] });
    }
    set.num_lidar = set.len();
    set
}

/// The raw attributes of a round Gaussian.
pub(crate) fn row(mean: [f32; 3], scale: f32, opacity: f32, colour: [f32; 3]) -> [f32; NUM_ATTRIBUTES] {
    let mut row = [0.0; NUM_ATTRIBUTES];
    row[MEAN].copy_from_slice(&mean);
    row[QUAT.start] = 1.0;
    row[LOG_SCALE].fill(scale.ln());
    row[LOGIT_OPACITY] = logit(opacity);
    row[LOGIT_COLOUR].copy_from_slice(&colour.map(logit));
    row
}
