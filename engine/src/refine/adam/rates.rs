//! Step sizes of the per-scene optimisation.

use super::VARIABLES;
use crate::gaussians::{LOG_SCALE, LOGIT_COLOUR, LOGIT_OPACITY, MEAN, QUAT};

/// Step sizes by attribute: how far one step moves a value whose gradient keeps its sign.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AdamRates {
    /// Of the mean, metres.
    pub mean: f64,
    /// Of the quaternion.
    pub quat: f64,
    /// Of the log scale.
    pub log_scale: f64,
    /// Of the opacity logit.
    pub logit_opacity: f64,
    /// Of the colour logit.
    pub logit_colour: f64,
    /// Of the velocity, metres a second.
    pub velocity: f64,
}

/// Attributes that share a step size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RateGroup {
    /// The mean.
    Mean,
    /// The quaternion.
    Quat,
    /// The log scale.
    LogScale,
    /// The opacity logit.
    LogitOpacity,
    /// The colour logit.
    LogitColour,
    /// The velocity.
    Velocity,
}

impl RateGroup {
    /// Every group.
    pub const ALL: [Self; 6] =
        [Self::LogitColour, Self::LogScale, Self::LogitOpacity, Self::Mean, Self::Quat, Self::Velocity];
}

impl Default for AdamRates {
    /// Found by `lgs-train rates`, one group after the other, on three validation scenes of the procedural street, on which nothing else is
    /// measured: one camera, three input frames, held-out PSNR averaged over 30 and 100 steps, beginning at the prediction. From 3D Gaussian
    /// splatting's rates at 80x160 (colour 0.02, scale 0.005) to colour 0.008, scale 0.2: 26.76 to 27.57 dB; then in factors of 2 at 128x256
    /// from colour 0.01, scale 0.05, opacity 0.05, mean 0.002: 27.24 to 27.44 dB. The optimum is flat, a factor of 2 in one of these
    /// changes less than 0.1 dB. Scales are half of what scored best (by 0.001 dB), which is better after 100 steps (27.51 to 27.44 dB);
    /// quaternion and velocity were left where they were.
    fn default() -> Self {
        Self { mean: 8e-3, quat: 1e-3, log_scale: 1e-1, logit_opacity: 1e-1, logit_colour: 1e-2, velocity: 2e-2 }
    }
}

impl AdamRates {
    /// The step size of a group.
    pub const fn of(&mut self, group: RateGroup) -> &mut f64 {
        match group {
            RateGroup::Mean => &mut self.mean,
            RateGroup::Quat => &mut self.quat,
            RateGroup::LogScale => &mut self.log_scale,
            RateGroup::LogitOpacity => &mut self.logit_opacity,
            RateGroup::LogitColour => &mut self.logit_colour,
            RateGroup::Velocity => &mut self.velocity,
        }
    }

    /// The step size of every variable.
    pub(super) fn by_variable(&self) -> [f64; VARIABLES] {
        let mut rates = [self.velocity; VARIABLES];
        rates[MEAN].fill(self.mean);
        rates[QUAT].fill(self.quat);
        rates[LOG_SCALE].fill(self.log_scale);
        rates[LOGIT_OPACITY] = self.logit_opacity;
        rates[LOGIT_COLOUR].fill(self.logit_colour);
        rates
    }
}
