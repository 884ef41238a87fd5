//! Sparse convolutions with batch normalisation.

use std::sync::Arc;

use candle_core::{Result, Tensor};
use candle_nn::{Init, VarBuilder};

use super::norm::BatchNorm;
use crate::ops::sparse_conv::{ConvWeights, KernelMap, convolve};

/// A sparse convolution without bias, then batch normalisation.
#[derive(Clone, Debug)]
pub(super) struct ConvNorm(Form);

#[derive(Clone, Debug)]
enum Form {
    Parts {
        weight: Tensor,
        norm: BatchNorm,
    },
    /// The running statistics in weights and biases, constant.
    Folded(ConvWeights),
}

/// Sizes of a convolution.
#[derive(Clone, Copy, Debug)]
pub(super) struct ConvSize {
    /// Edge of the kernel.
    pub(super) kernel: usize,
    /// Input channels.
    pub(super) cin: usize,
    /// Output channels.
    pub(super) cout: usize,
}

impl ConvSize {
    /// Values that each output is a sum over.
    pub(super) fn fan_in(self) -> f64 {
        (self.kernel.pow(3) * self.cin) as f64
    }

    /// Makes or loads `weight` `[cout, k, k, k, cin]`.
    pub(super) fn weight(self, init: Init, vb: &VarBuilder<'_>) -> Result<Tensor> {
        let Self { kernel, cin, cout } = self;
        vb.get_with_hints((cout, kernel, kernel, kernel, cin), "weight", init)
    }
}

impl ConvNorm {
    /// Makes or loads `conv.weight` `[cout, k, k, k, cin]` and `norm.{weight, bias, running_mean, running_var}` `[cout]`.
    pub(super) fn new(size: ConvSize, init: Init, eps: f64, vb: &VarBuilder<'_>) -> Result<Self> {
        let weight = size.weight(init, &vb.pp("conv"))?;
        Ok(Self(Form::Parts { weight, norm: BatchNorm::new(size.cout, eps, &vb.pp("norm"))? }))
    }

    /// The normalised convolution, `residual` added where there is one, then negative results zero where `relu`.
    ///
    /// # Shapes
    /// `features` `[map.num_inputs, cin]`, `residual` and result `[map.num_outputs, cout]`.
    ///
    /// # Formula
    /// With running statistics one convolution: `W' = W gamma / sqrt(var + eps)`, `b' = beta - mean gamma / sqrt(var + eps)`.
    ///
    /// # Gradient
    /// By all tensors. With `train` the statistics are those of the rows at hand, which also enter the running ones; without, the running ones,
    /// as constants.
    pub(super) fn forward(
        &self,
        features: &Tensor,
        residual: Option<&Tensor>,
        map: &Arc<KernelMap>,
        train: bool,
        relu: bool,
    ) -> Result<Tensor> {
        let weights = match &self.0 {
            Form::Folded(weights) => weights.clone(),
            Form::Parts { weight, norm } => {
                if train && map.num_outputs() > 1 {
                    let convolved = convolve(features, &ConvWeights::without_bias(weight)?, None, map, false)?;
                    if let Some(mut normalised) = norm.by_batch(&convolved)? {
                        if let Some(residual) = residual {
                            normalised = (normalised + residual)?;
                        }
                        return if relu { normalised.relu() } else { Ok(normalised) };
                    }
                }
                ConvWeights::new(weight, &norm.affine()?)?
            }
        };
        convolve(features, &weights, residual, map, relu)
    }

    /// The layer as inference runs it, to the bit what it is with running statistics.
    pub(super) fn fold(&self) -> Result<Self> {
        Ok(Self(Form::Folded(match &self.0 {
            Form::Parts { weight, norm } => ConvWeights::new(weight, &norm.affine()?)?.detach(),
            Form::Folded(weights) => weights.clone(),
        })))
    }
}
