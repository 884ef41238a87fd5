//! Gradients of whole networks against finite differences.

use candle_core::{Result, Tensor, Var};

use crate::Outcome;
use crate::random::Random;

/// How a gradient is checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slopes {
    /// Directions along which the loss is followed.
    pub directions: usize,
    /// How far the finite difference may be off, as a part of the slope.
    pub tolerance: f64,
    /// By how much the loss changes over half a difference: more than what f32 hides, less than where the slope bends.
    pub change: f64,
    /// Seed of the directions.
    pub seed: u64,
}

impl Slopes {
    /// Fails unless the loss rises along random directions as its gradient by the variables says, which every one has.
    ///
    /// A direction follows the gradient's own signs: nothing cancels, so that f32 is enough to see the slope.
    pub fn check(&self, variables: &[(String, Var)], loss: &dyn Fn() -> Result<Tensor>) -> Outcome {
        let failed = |error: candle_core::Error| libtest_mimic::Failed::from(error.to_string());
        let gradients = loss().and_then(|l| l.backward()).map_err(failed)?;
        let mut random = Random::new(self.seed);
        for direction in 0..self.directions {
            let (mut slope, mut steps) = (0.0_f64, Vec::new());
            for (name, variable) in variables {
                let gradient = gradients.get(variable).ok_or_else(|| format!("{name} has no gradient"))?;
                let gradient = gradient.flatten_all().and_then(|g| g.to_vec1::<f32>()).map_err(failed)?;
                let step: Vec<f32> = gradient.iter().map(|g| g.signum() * random.uniform_single(0.2, 1.0)).collect();
                slope += gradient.iter().zip(&step).map(|(g, s)| f64::from(*g) * f64::from(*s)).sum::<f64>();
                steps.push(Tensor::from_vec(step, variable.shape(), variable.device()).map_err(failed)?);
            }
            let length = self.change / slope.abs().max(1e-3);
            let measured = difference(variables, &steps, length, loss).map_err(failed)?;
            if (measured - slope).abs() > self.tolerance * slope.abs() || slope == 0.0 {
                let tolerance = self.tolerance * slope.abs();
                let text = format!("direction {direction}: got {slope:e}, want {measured:e}, tolerance {tolerance:e}");
                return Err(text.into());
            }
        }
        Ok(())
    }
}

/// The central difference of the loss along `steps`, after which the variables are what they were.
fn difference(
    variables: &[(String, Var)],
    steps: &[Tensor],
    length: f64,
    loss: &dyn Fn() -> Result<Tensor>,
) -> Result<f64> {
    let starts: Vec<Tensor> = variables.iter().map(|(_, v)| v.as_tensor().copy()).collect::<Result<_>>()?;
    let mut moved = [0.0; 2];
    for (value, side) in moved.iter_mut().zip([1.0, -1.0]) {
        for ((_, variable), (start, step)) in variables.iter().zip(starts.iter().zip(steps)) {
            variable.set(&(start + (step * (side * length))?)?)?;
        }
        *value = f64::from(loss()?.to_scalar::<f32>()?);
    }
    for ((_, variable), start) in variables.iter().zip(&starts) {
        variable.set(start)?;
    }
    Ok((moved[0] - moved[1]) / (2.0 * length))
}
