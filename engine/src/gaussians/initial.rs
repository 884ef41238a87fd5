//! The scene that the sweeps start it with: one Gaussian per coloured return.

use super::{
    GaussianSet, LOG_SCALE, LOGIT_COLOUR, LOGIT_OPACITY, MEAN, NUM_ATTRIBUTES, QUAT,
    physical::{MAX_SCALE, MIN_SCALE, logit},
};
use crate::points::PointCloud;

/// Opacity of a Gaussian before anything was learned (specification, section 4).
const OPACITY: f32 = 0.5;

/// One Gaussian per point that has a colour, in the order of the cloud; velocity zero.
///
/// # Shapes
/// `colours` `[N, 3]`, `spacing` `[N]` metres.
///
/// # Formula
/// `x` = point, `s = ln(clamp(spacing, 1e-4, 1))` on all three axes, `q = 1`, `alpha = logit(0.5)`, `c = logit(colour)`.
///
/// # Source
/// `Flux4D`, initial values of its `LiDAR` branch; the random rotation left out.
pub fn initial(cloud: &PointCloud, colours: &[Option<[f32; 3]>], spacing: &[f32]) -> GaussianSet {
    let mut set = GaussianSet::default();
    for (i, colour) in colours.iter().enumerate() {
        let Some(colour) = colour else { continue };
        set.attributes.push(row(cloud.positions[i], spacing[i].clamp(MIN_SCALE, MAX_SCALE), OPACITY, *colour));
        set.times.push(cloud.times[i]);
    }
    set.num_lidar = set.len();
    set.velocities = vec![[0.0; 3]; set.len()];
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
