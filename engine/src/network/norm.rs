//! Normalisation of rows and of columns.

use candle_core::{DType, Result, Tensor, Var};
use candle_nn::{Init, VarBuilder};

use crate::ops::norm::{self, BatchStatistics, RowNorm};

/// Added to the variance of a row (`PyTorch`'s default).
const LAYER_EPS: f32 = 1e-5;
/// Share of the batch at hand in the running statistics: a batch is one scene, and scenes differ.
const MOMENTUM: f64 = 0.05;

/// Normalisation of rows.
#[derive(Clone, Debug)]
pub(super) struct LayerNorm {
    weight: Tensor,
    bias: Tensor,
}

/// Normalisation of columns.
#[derive(Clone, Debug)]
pub(super) struct BatchNorm(Form);

#[derive(Clone, Debug)]
enum Form {
    /// By the batch at hand or by running statistics; where the builder hands out variables, those.
    Statistics { weight: Tensor, bias: Tensor, running_mean: Var, running_var: Var, eps: f64 },
    /// What running statistics come to, constant: `[2, width]` factors and shifts.
    Affine(Tensor),
}

impl LayerNorm {
    /// Makes or loads `weight` and `bias` `[width]`.
    pub(super) fn new(width: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        Ok(Self {
            weight: vb.get_with_hints(width, "weight", Init::Const(1.0))?,
            bias: vb.get_with_hints(width, "bias", Init::Const(0.0))?,
        })
    }

    pub(super) fn forward(&self, x: &Tensor) -> Result<Tensor> {
        norm::layer_norm(x, &self.weight, &self.bias, LAYER_EPS)
    }

    /// Its parameters as constants.
    pub(super) fn row_norm(&self) -> Result<RowNorm> {
        RowNorm::new(&self.weight, &self.bias, LAYER_EPS)
    }
}

impl BatchNorm {
    /// Makes or loads `weight`, `bias`, `running_mean`, `running_var` `[width]`; `eps` is added to the variance.
    pub(super) fn new(width: usize, eps: f64, vb: &VarBuilder<'_>) -> Result<Self> {
        let get = |name, value| vb.get_with_hints(width, name, Init::Const(value));
        Ok(Self(Form::Statistics {
            weight: get("weight", 1.0)?,
            bias: get("bias", 0.0)?,
            // Variables of a builder are shared, so what training notes here is saved with them.
            running_mean: Var::from_tensor(&get("running_mean", 0.0)?)?,
            running_var: Var::from_tensor(&get("running_var", 1.0)?)?,
            eps,
        }))
    }

    /// `x` `[N, width]` by its own statistics, which also enter the running ones; `None` where there is no batch: fewer than two rows, or the
    /// statistics are folded away.
    ///
    /// # Gradient
    /// By all tensors, through the statistics.
    pub(super) fn by_batch(&self, x: &Tensor) -> Result<Option<Tensor>> {
        match &self.0 {
            Form::Statistics { weight, bias, running_mean, running_var, eps } if x.dim(0)? > 1 => {
                let (normalised, batch) = norm::batch_norm(x, weight, bias, *eps)?;
                follow(running_mean, &batch.mean)?;
                follow(running_var, &unbiased(&batch))?;
                Ok(Some(normalised))
            }
            _ => Ok(None),
        }
    }

    /// What running statistics do: `[2, width]` factors and shifts.
    ///
    /// # Gradient
    /// By weight and bias; the statistics are constants.
    pub(super) fn affine(&self) -> Result<Tensor> {
        match &self.0 {
            Form::Statistics { weight, bias, running_mean, running_var, eps } => {
                let [mean, variance] = [running_mean, running_var].map(Var::as_detached_tensor);
                let factor = (weight * (variance + *eps)?.sqrt()?.recip()?)?;
                let shift = (bias - (mean * &factor)?)?;
                Tensor::stack(&[factor, shift], 0)
            }
            Form::Affine(affine) => Ok(affine.clone()),
        }
    }

    /// With `train` as [`BatchNorm::by_batch`], where there is a batch; else by running statistics.
    pub(super) fn forward(&self, x: &Tensor, train: bool) -> Result<Tensor> {
        if train && let Some(normalised) = self.by_batch(x)? {
            return Ok(normalised);
        }
        let affine = self.affine()?;
        x.broadcast_mul(&affine.get(0)?)?.broadcast_add(&affine.get(1)?)
    }

    /// With the running statistics folded away.
    pub(super) fn fold(&self) -> Result<Self> {
        Ok(Self(Form::Affine(self.affine()?.detach())))
    }
}

/// The variance without bias, as `PyTorch` keeps it.
fn unbiased(batch: &BatchStatistics) -> Vec<f64> {
    let factor = batch.count as f64 / (batch.count as f64 - 1.0);
    batch.variance.iter().map(|v| v * factor).collect()
}

/// Moves running statistics towards those of a batch.
fn follow(running: &Var, batch: &[f64]) -> Result<()> {
    let old = running.to_dtype(DType::F64)?.to_vec1::<f64>()?;
    let new: Vec<f64> = old.iter().zip(batch).map(|(old, batch)| old + MOMENTUM * (batch - old)).collect();
    running.set(&Tensor::from_vec(new, running.dims(), running.device())?.to_dtype(running.dtype())?)
}
