//! Layers of the trainable form.

use candle_core::{DType, Result, Tensor, Var};
use candle_nn::{Init, VarBuilder};

pub(super) use crate::network::linear::Linear;
use crate::ops::norm;

/// Added to the variance of a row (`PyTorch`'s default).
pub(super) const LAYER_EPS: f32 = 1e-5;
/// Added to the variance of a column (Point Transformer V3's choice).
pub(super) const BATCH_EPS: f64 = 1e-3;
/// Share of the batch at hand in the running statistics: a batch is one scene, as in the other networks.
const MOMENTUM: f64 = 0.05;

/// Normalisation of rows.
#[derive(Clone, Debug)]
pub(super) struct LayerNorm {
    pub(super) weight: Tensor,
    pub(super) bias: Tensor,
}

/// Normalisation of columns, by the batch in training, by running statistics else.
#[derive(Clone, Debug)]
pub(super) struct BatchNorm {
    weight: Tensor,
    bias: Tensor,
    running_mean: Var,
    running_var: Var,
}

/// What a [`BatchNorm`] does with running statistics: `x factor + shift`.
#[derive(Clone, Debug)]
pub(super) struct Affine {
    pub(super) factor: Vec<f64>,
    pub(super) shift: Vec<f64>,
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
}

impl BatchNorm {
    /// Makes or loads `weight`, `bias`, `running_mean`, `running_var` `[width]`.
    pub(super) fn new(width: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let get = |name, value| vb.get_with_hints(width, name, Init::Const(value));
        Ok(Self {
            weight: get("weight", 1.0)?,
            bias: get("bias", 0.0)?,
            // Variables of a builder are shared, so what training notes here is saved with them.
            running_mean: Var::from_tensor(&get("running_mean", 0.0)?)?,
            running_var: Var::from_tensor(&get("running_var", 1.0)?)?,
        })
    }

    /// With `train` by the rows at hand, whose moments enter the running statistics.
    pub(super) fn forward(&self, x: &Tensor, train: bool) -> Result<Tensor> {
        if train {
            let (out, statistics) = norm::batch_norm(x, &self.weight, &self.bias, BATCH_EPS)?;
            let unbiased = statistics.count as f64 / statistics.count.saturating_sub(1).max(1) as f64;
            blend(&self.running_mean, &statistics.mean, 1.0)?;
            blend(&self.running_var, &statistics.variance, unbiased)?;
            return Ok(out);
        }
        let scale = (self.running_var.as_detached_tensor() + BATCH_EPS)?.sqrt()?.recip()?;
        let factor = (&self.weight * scale)?;
        let shift = (&self.bias - (&factor * self.running_mean.as_detached_tensor())?)?;
        x.broadcast_mul(&factor)?.broadcast_add(&shift)
    }

    pub(super) fn fold(&self) -> Result<Affine> {
        let [weight, bias] = [&self.weight, &self.bias].map(doubles);
        let [mean, variance] = [&self.running_mean, &self.running_var].map(|var| doubles(var.as_tensor()));
        let factor: Vec<f64> = weight?.iter().zip(variance?).map(|(w, v)| w / (v + BATCH_EPS).sqrt()).collect();
        let shift = bias?.iter().zip(mean?).zip(&factor).map(|((b, m), f)| b - m * f).collect();
        Ok(Affine { factor, shift })
    }
}

/// Moves running statistics towards those of a batch.
fn blend(running: &Var, batch: &[f64], factor: f64) -> Result<()> {
    let batch = Tensor::from_slice(batch, batch.len(), running.device())?.to_dtype(running.dtype())?;
    let kept = (running.as_detached_tensor() * (1.0 - MOMENTUM))?;
    running.set(&(kept + (batch * (MOMENTUM * factor))?)?)
}

/// Values of a tensor in f64.
pub(super) fn doubles(tensor: &Tensor) -> Result<Vec<f64>> {
    tensor.to_dtype(DType::F64)?.flatten_all()?.to_vec1()
}

/// Values of a tensor in f32.
pub(super) fn singles(tensor: &Tensor) -> Result<Vec<f32>> {
    tensor.to_dtype(DType::F32)?.flatten_all()?.to_vec1()
}
