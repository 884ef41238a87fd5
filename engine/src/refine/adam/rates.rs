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
    /// Found in three rounds. By `lgs-sweep rates` on three validation scenes of the procedural street, one group after the other, beginning at the
    /// prediction: from 3D Gaussian splatting's rates at 80x160 (colour 0.02, scale 0.005) to colour 0.01, scale and opacity 0.1, mean 0.008. Then
    /// on five real clips and a procedural test scene, four steps behind two learned ones, held-out PSNR: 27.89 dB with these, 27.93 with a colour
    /// of 0.04, 27.97 with scale and opacity of 0.2 beside it, 28.06 with a mean of 0.004 and a first decay of 0.6 where it was 0.8, and depth
    /// errors 5 % smaller. Thirty steps from the start, three real clips and a test scene: 30.88 to 31.24 dB. Rates of the mean by each Gaussian's
    /// size change less than 0.02 dB. Then, by steps that look at a view each, on six real clips: 27.73 to 27.75 dB and 3 % of the depth errors with a
    /// quarter of the velocity, three times the quaternion and 1.25 times the scale; all others are flat there. `measure/NEEDS.md` has the tables.
    fn default() -> Self {
        Self { mean: 4e-3, quat: 3e-3, log_scale: 2.5e-1, logit_opacity: 2e-1, logit_colour: 4e-2, velocity: 5e-3 }
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
