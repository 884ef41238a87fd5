//! Convolution with batch normalisation: the trainable form, and the folded form that inference runs.

use std::sync::Arc;

use candle_core::{DType, Result, Tensor, Var};
use candle_nn::{Init, VarBuilder};

use crate::ops::norm::{BatchStatistics, batch_norm};
use crate::ops::sparse_conv::{Epilogue, KernelMap, PackedWeights, convolve, convolve_affine, convolve_into};

/// Added to the variance (`PyTorch`'s default).
const NORM_EPS: f64 = 1e-5;
/// Share of a batch in the running statistics: a batch is one scene, and scenes differ.
const MOMENTUM: f64 = 0.05;

/// A sparse convolution without bias, then batch normalisation.
#[derive(Clone, Debug)]
pub struct ConvNorm {
    weight: Tensor,
    gamma: Tensor,
    beta: Tensor,
    /// Mean and variance; where the builder hands out variables, those.
    running: [Var; 2],
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
        let norm = vb.pp("norm");
        let running_mean = norm.get_with_hints(cout, "running_mean", Init::Const(0.0))?;
        let running_var = norm.get_with_hints(cout, "running_var", Init::Const(1.0))?;
        Ok(Self {
            weight,
            gamma: norm.get_with_hints(cout, "weight", Init::Const(1.0))?,
            beta: norm.get_with_hints(cout, "bias", Init::Const(0.0))?,
            running: [Var::from_tensor(&running_mean)?, Var::from_tensor(&running_var)?],
            kernel,
            cin,
            cout,
        })
    }

    /// The normalised convolution, negative results zero where `relu`, differentiable.
    ///
    /// # Shapes
    /// `[map.num_inputs, cin]` to `[map.num_outputs, cout]`.
    ///
    /// # Gradient
    /// By the features and by all parameters. With `train` the statistics are those of the rows at hand, which also enter the
    /// running ones; without, the running ones, as constants.
    ///
    /// # Errors
    /// When the shape does not fit.
    pub fn forward(&self, features: &Tensor, map: &Arc<KernelMap>, train: bool, relu: bool) -> Result<Tensor> {
        if train && map.num_outputs() > 1 {
            let convolved = convolve(features, &self.weight, map)?;
            let (normalised, statistics) = batch_norm(&convolved, &self.gamma, &self.beta, NORM_EPS)?;
            self.follow(&statistics)?;
            return if relu { normalised.relu() } else { Ok(normalised) };
        }
        let [mean, variance] = self.running.each_ref().map(|v| v.as_tensor().detach());
        let factor = (&self.gamma * (variance + NORM_EPS)?.sqrt()?.recip()?)?;
        let shift = (&self.beta - (mean * &factor)?)?;
        convolve_affine(features, &self.weight, &Tensor::stack(&[factor, shift], 0)?, map, relu)
    }

    /// Moves the running statistics towards those of a batch (the variance without bias, as `PyTorch` keeps it).
    fn follow(&self, batch: &BatchStatistics) -> Result<()> {
        let unbiased = batch.count as f64 / (batch.count as f64 - 1.0);
        let targets = [batch.mean.clone(), batch.variance.iter().map(|v| v * unbiased).collect()];
        for (running, target) in self.running.iter().zip(targets) {
            let old = running.to_vec1::<f32>()?;
            let new: Vec<f32> =
                old.iter().zip(target).map(|(&o, t)| single(f64::from(o) + MOMENTUM * (t - f64::from(o)))).collect();
            running.set(&Tensor::from_vec(new, self.cout, running.device())?)?;
        }
        Ok(())
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
        let (mean, variance) = (values(&self.running[0])?, values(&self.running[1])?);
        let (gamma, beta) = (values(&self.gamma)?, values(&self.beta)?);
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
