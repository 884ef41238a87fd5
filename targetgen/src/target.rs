//! From deltas to targets of the scores.

use lgs_formats::casts::to_f32;
use lgs_formats::targets::{ActionTargets, TargetsConfig, ZScore};

/// A deviation below this part of the largest value is rounding noise of single precision, not variance.
const NO_VARIANCE: f64 = 1e-7;

/// Mean and standard deviation of transformed deltas.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    /// Mean.
    pub mean: f64,
    /// Standard deviation of the population; 0 where there is no variance.
    pub deviation: f64,
}

/// Targets of both actions, with what they were scored against.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Targets {
    /// Of taking the primitive out.
    pub prune: ActionTargets,
    /// Of a copy.
    pub add: ActionTargets,
    /// Of prune and add.
    pub moments: [Moments; 2],
}

/// The transformed delta: monotone, odd, and bent from `scale` on.
///
/// # Formula
/// `sign(d) ln(1 + |d| / scale)`.
pub fn signed_log(delta: f64, scale: f64) -> f64 {
    let ratio = delta.abs() / scale;
    // Beyond f64 the 1 does not count.
    let size = if ratio.is_finite() { ratio.ln_1p() } else { delta.abs().ln() - scale.ln() };
    size.copysign(delta)
}

impl Moments {
    /// Those of values, in their order, in f64.
    pub fn of(values: &[f64]) -> Self {
        let count = values.len().max(1) as f64;
        let mean = values.iter().sum::<f64>() / count;
        let deviation = (values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / count).sqrt();
        let largest = values.iter().fold(0.0_f64, |max, v| max.max(v.abs()));
        Self { mean, deviation: if deviation > NO_VARIANCE * largest { deviation } else { 0.0 } }
    }

    /// The target of a transformed delta: above 0.5 where the action helps.
    ///
    /// # Formula
    /// `sigmoid(-(t - mean) / deviation)`, and 0.5 without variance.
    pub fn target(&self, transformed: f64) -> f64 {
        if self.deviation == 0.0 { 0.5 } else { 1.0 / (1.0 + ((transformed - self.mean) / self.deviation).exp()) }
    }
}

/// Targets of raw deltas `[M]` under their masks.
pub fn targets(deltas: [&[f32]; 2], masks: [&[bool]; 2], config: &TargetsConfig) -> Targets {
    let transformed = [0, 1].map(|a| -> Vec<f64> {
        deltas[a].iter().map(|&delta| signed_log(f64::from(delta), config.log_scale)).collect()
    });
    let valid = |a: usize| transformed[a].iter().zip(masks[a]).filter(|(_, set)| **set).map(|(&t, _)| t);
    let moments = match config.zscore {
        ZScore::Joint => [Moments::of(&valid(0).chain(valid(1)).collect::<Vec<f64>>()); 2],
        ZScore::PerAction => [0, 1].map(|a| Moments::of(&valid(a).collect::<Vec<f64>>())),
    };
    let [prune, add] = [0, 1].map(|a| ActionTargets {
        y: transformed[a]
            .iter()
            .zip(masks[a])
            .map(|(&t, &set)| if set { to_f32(moments[a].target(t)) } else { 0.5 })
            .collect(),
        delta: deltas[a].to_vec(),
        mask: masks[a].to_vec(),
    });
    Targets { prune, add, moments }
}

/// Raw deltas as they are stored, and the mask; 0 where there is none.
pub fn stored(deltas: &[Option<f64>]) -> (Vec<f32>, Vec<bool>) {
    deltas.iter().map(|delta| (delta.map_or(0.0, to_f32), delta.is_some())).unzip()
}
