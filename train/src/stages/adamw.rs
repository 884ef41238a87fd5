//! Adam with decoupled weight decay.
//!
//! # Source
//! Loshchilov and Hutter, Decoupled weight decay regularization, 2019.

use lgs_engine::network::weights::TensorSpec;
use rayon::prelude::*;

use super::variables::{Values, Variables};
use crate::error::Result;

/// Decay of the mean of gradients.
const BETA1: f64 = 0.9;
/// Decay of the mean of squared gradients: shorter than usual, because every step sees another scene.
const BETA2: f64 = 0.99;
/// Added to the root of the mean square. Gradients of a mean over pixels are small, so it is smaller than usual.
const EPS: f64 = 1e-10;

/// Moments of the gradients.
#[derive(Clone, Debug, PartialEq)]
pub struct AdamW {
    /// Means.
    pub first: Values,
    /// Means of squares.
    pub second: Values,
    /// Updates so far.
    pub updates: u64,
}

/// How large an update is.
#[derive(Clone, Copy, Debug)]
pub struct Update {
    /// The learning rate.
    pub rate: f64,
    /// Weight decay.
    pub decay: f64,
}

impl AdamW {
    /// An optimiser that has seen no gradient yet.
    pub fn new(variables: &Variables) -> Self {
        Self { first: variables.zeros(), second: variables.zeros(), updates: 0 }
    }

    /// Moves every tensor for which `trained` holds against its gradient.
    ///
    /// # Formula
    /// `m <- b1 m + (1 - b1) g`, `s <- b2 s + (1 - b2) g^2`, `w <- w - rate (m' / (sqrt(s') + eps) + decay w)`, m' and s' without their bias
    /// towards zero; decay for tensors of two and more dimensions only.
    ///
    /// # Errors
    /// When a tensor cannot be read or set.
    pub fn update(
        &mut self,
        variables: &Variables,
        gradients: &Values,
        update: Update,
        trained: impl Fn(&TensorSpec) -> bool,
    ) -> Result<()> {
        self.updates += 1;
        let exponent = self.updates as f64;
        let unbias = [BETA1, BETA2].map(|beta| 1.0 / (1.0 - libm::pow(beta, exponent)));
        let mut values = variables.values()?;
        for (k, spec) in variables.specs().iter().enumerate() {
            if !trained(spec) {
                continue;
            }
            let decay = if spec.shape.len() > 1 { update.decay } else { 0.0 };
            let moments = self.first[k].par_iter_mut().zip(&mut self.second[k]);
            values[k].par_iter_mut().zip(&gradients[k]).zip(moments).with_min_len(4096).for_each(
                |((w, &g), (m, s))| {
                    let (g, old) = (f64::from(g), f64::from(*w));
                    let mean = BETA1 * f64::from(*m) + (1.0 - BETA1) * g;
                    let square = BETA2 * f64::from(*s) + (1.0 - BETA2) * g * g;
                    let direction = mean * unbias[0] / ((square * unbias[1]).sqrt() + EPS);
                    *w = single(old - update.rate * (direction + decay * old));
                    (*m, *s) = (single(mean), single(square));
                },
            );
            variables.set(k, std::mem::take(&mut values[k]))?;
        }
        Ok(())
    }
}

/// The norm of the gradients of all tensors for which `trained` holds, summed in their order in f64.
pub fn norm(gradients: &Values, specs: &[TensorSpec], trained: impl Fn(&TensorSpec) -> bool) -> f64 {
    let chosen = gradients.iter().zip(specs).filter(|(_, spec)| trained(spec));
    chosen.map(|(values, _)| values.iter().map(|&v| f64::from(v) * f64::from(v)).sum::<f64>()).sum::<f64>().sqrt()
}

/// Multiplies all gradients.
pub fn scale(gradients: &mut Values, factor: f64) {
    for values in gradients {
        values.iter_mut().for_each(|v| *v = single(f64::from(*v) * factor));
    }
}

#[expect(clippy::cast_possible_truncation, reason = "weights and moments are stored in f32")]
fn single(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use lgs_engine::network::config::ModelConfig;

    use super::{AdamW, Update, norm, scale};
    use crate::stages::variables::Variables;

    #[test]
    fn two_updates_by_hand() {
        let text = r#"{"format": "lgs-model/1", "name": "t", "voxel_size": 0.1, "background_voxel_size": 1.0,
            "unet": {"stem": 2, "encoder": [], "decoder": []}, "background_unet": {"stem": 2, "encoder": [], "decoder": []}}"#;
        let config = ModelConfig::parse(text, Path::new("t")).unwrap();
        let variables = Variables::seeded(&config, 1).unwrap();
        let at = |name: &str| variables.specs().iter().position(|s| s.name == name).unwrap();
        let (weight, bias) = (at("initial.heads.gaussian.weight"), at("initial.heads.gaussian.bias"));
        let mut gradients = variables.zeros();
        (gradients[weight][3], gradients[bias][0]) = (0.5, -2.0);
        assert_eq!(norm(&gradients, variables.specs(), |s| s.name.ends_with("bias")), 2.0);
        let mut adam = AdamW::new(&variables);
        let update = Update { rate: 0.01, decay: 0.1 };
        let frozen = |s: &lgs_engine::network::weights::TensorSpec| !s.name.contains("unet");
        let start = variables.values().unwrap();
        adam.update(&variables, &gradients, update, frozen).unwrap();
        let value = |k: usize, i: usize| variables.values().unwrap()[k][i];
        // The first step is the learning rate, whatever the gradient's size.
        assert!((value(weight, 3) + 0.01).abs() < 1e-7 && (value(bias, 0) - 0.01).abs() < 1e-7);
        scale(&mut gradients, -1.0);
        adam.update(&variables, &gradients, update, frozen).unwrap();
        // m = 0.9 0.1 - 0.1 = -0.01 of the first, over 1 - 0.9^2; the root mean square is 1 of it.
        let direction = -0.01 / 0.19;
        assert!((f64::from(value(weight, 3)) - (-0.01 - 0.01 * (direction - 0.1 * 0.01))).abs() < 1e-7);
        assert!((f64::from(value(bias, 0)) - (0.01 + 0.01 * direction)).abs() < 1e-7);
        let after = variables.values().unwrap();
        let unet = at("initial.unet.stem.0.conv.weight");
        assert_eq!(start[unet], after[unet], "what is not trained stays");
    }
}
