//! Convolution with batch normalisation: the trainable form, and the folded form that inference runs.

use std::sync::Arc;

use candle_core::{DType, Result, Tensor};
use candle_nn::{Init, ModuleT, VarBuilder};

use crate::ops::sparse_conv::{Epilogue, KernelMap, PackedWeights, convolve, convolve_into};

/// Added to the variance (`PyTorch`'s default).
const NORM_EPS: f64 = 1e-5;

/// A sparse convolution without bias, then batch normalisation.
#[derive(Clone, Debug)]
pub struct ConvNorm {
    weight: Tensor,
    norm: candle_nn::BatchNorm,
    kernel: usize,
    cin: usize,
    cout: usize,
}

/// A [`ConvNorm`] with the running statistics folded into weights and bias.
#[derive(Clone, Debug)]
pub struct FoldedConv {
    weights: PackedWeights,
    bias: Vec<f32>,
    cout: usize,
}

impl ConvNorm {
    /// Makes or loads `conv.weight` `[cout, k, k, k, cin]` and `norm.{weight, bias, running_mean, running_var}` `[cout]`.
    ///
    /// # Errors
    /// When the builder has no such tensor.
    pub fn new(kernel: usize, cin: usize, cout: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let stdev = (2.0 / (kernel.pow(3) * cin) as f64).sqrt();
        let weight = vb.pp("conv").get_with_hints(
            (cout, kernel, kernel, kernel, cin),
            "weight",
            Init::Randn { mean: 0.0, stdev },
        )?;
        let config = candle_nn::BatchNormConfig { eps: NORM_EPS, ..Default::default() };
        Ok(Self { weight, norm: candle_nn::batch_norm(cout, config, vb.pp("norm"))?, kernel, cin, cout })
    }

    /// The normalised convolution, differentiable.
    ///
    /// # Shapes
    /// `[map.num_inputs, cin]` to `[map.num_outputs, cout]`.
    ///
    /// # Gradient
    /// By the features and by all parameters. With `train` the statistics are those of the rows at hand.
    ///
    /// # Errors
    /// When the shape does not fit.
    pub fn forward(&self, features: &Tensor, map: &Arc<KernelMap>, train: bool) -> Result<Tensor> {
        self.norm.forward_t(&convolve(features, &self.weight, map)?, train)
    }

    /// The form that inference runs.
    ///
    /// # Formula
    /// `W' = W gamma / sqrt(var + eps)`, `b' = beta - mean gamma / sqrt(var + eps)`.
    ///
    /// # Errors
    /// When a tensor cannot be read.
    pub fn fold(&self) -> Result<FoldedConv> {
        let values = |t: &Tensor| t.to_dtype(DType::F32)?.flatten_all()?.to_vec1::<f32>();
        let weight = values(&self.weight)?;
        let (mean, variance) = (values(self.norm.running_mean())?, values(self.norm.running_var())?);
        let (gamma, beta) = match self.norm.weight_and_bias() {
            Some((gamma, beta)) => (values(gamma)?, values(beta)?),
            None => (vec![1.0; self.cout], vec![0.0; self.cout]),
        };
        let factor: Vec<f64> =
            gamma.iter().zip(&variance).map(|(&g, &v)| f64::from(g) / (f64::from(v) + NORM_EPS).sqrt()).collect();
        let per_output = self.kernel.pow(3) * self.cin;
        let scaled: Vec<f32> =
            weight.iter().enumerate().map(|(i, &w)| single(f64::from(w) * factor[i / per_output])).collect();
        let bias = (0..self.cout).map(|c| single(f64::from(beta[c]) - f64::from(mean[c]) * factor[c])).collect();
        let weights = PackedWeights::of_checkpoint(&scaled, self.kernel.pow(3), self.cin, self.cout);
        Ok(FoldedConv { weights, bias, cout: self.cout })
    }
}

impl FoldedConv {
    /// The convolution with bias, `residual` added where there is one, then the rectifier where `relu`.
    ///
    /// # Shapes
    /// `features` `[map.num_inputs, cin]`, `residual` and `out` `[map.num_outputs, cout]`.
    pub fn forward(&self, features: &[f32], map: &KernelMap, residual: Option<&[f32]>, relu: bool, out: &mut [f32]) {
        convolve_into(features, &self.weights, map, &Epilogue { bias: Some(&self.bias), residual, relu }, out);
    }

    /// Number of output channels.
    pub fn cout(&self) -> usize {
        self.cout
    }
}

#[expect(clippy::cast_possible_truncation, reason = "parameters are stored in f32")]
fn single(value: f64) -> f32 {
    value as f32
}
