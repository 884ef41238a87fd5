//! Linear layers: the one trainable form, and the form that inference runs on points by the kernels of the sparse convolution.

use candle_core::{Result, Tensor};
use candle_nn::{Init, VarBuilder};

use crate::ops::dense;
use crate::ops::sparse_conv::{Epilogue, KernelMap, PackedWeights, convolve_into};

/// `x W^T + b`.
#[derive(Clone, Debug)]
pub struct Linear {
    pub(in crate::network) weight: Tensor,
    /// Constant zeros in a layer without bias.
    pub(in crate::network) bias: Tensor,
}

/// A [`Linear`] with its weights packed.
#[derive(Clone, Debug)]
pub struct PackedLinear {
    weights: PackedWeights,
    bias: Vec<f32>,
}

impl Linear {
    /// Makes or loads `weight` `[outputs, inputs]` and `bias` `[outputs]`, uniform within `1 / sqrt(inputs)`.
    ///
    /// # Errors
    /// When the builder has no such tensor.
    pub fn new(inputs: usize, outputs: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let reach = 1.0 / (inputs as f64).sqrt();
        let init = Init::Uniform { lo: -reach, up: reach };
        Ok(Self {
            weight: vb.get_with_hints((outputs, inputs), "weight", init)?,
            bias: vb.get_with_hints(outputs, "bias", init)?,
        })
    }

    /// As [`Linear::new`], but zero until it is trained.
    ///
    /// # Errors
    /// As [`Linear::new`].
    pub fn zero(inputs: usize, outputs: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let bias = vb.get_with_hints(outputs, "bias", Init::Const(0.0))?;
        Ok(Self { bias, ..Self::zero_without_bias(inputs, outputs, vb)? })
    }

    /// As [`Linear::zero`], without a `bias`.
    ///
    /// # Errors
    /// As [`Linear::new`].
    pub fn zero_without_bias(inputs: usize, outputs: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let weight = vb.get_with_hints((outputs, inputs), "weight", Init::Const(0.0))?;
        Ok(Self { bias: Tensor::zeros(outputs, weight.dtype(), weight.device())?, weight })
    }

    /// The layer, differentiable. `[N, inputs]` to `[N, outputs]`.
    ///
    /// # Errors
    /// When the shape does not fit.
    pub fn forward(&self, x: &Tensor) -> Result<Tensor> {
        dense::linear(x, &self.weight, &self.bias)
    }

    /// The form that inference runs.
    ///
    /// # Errors
    /// When a tensor cannot be read.
    pub fn pack(&self) -> Result<PackedLinear> {
        let (outputs, inputs) = self.weight.dims2()?;
        let values = |t: &Tensor| t.flatten_all()?.to_vec1::<f32>();
        let weights = PackedWeights::of_checkpoint(&values(&self.weight)?, 1, inputs, outputs);
        Ok(PackedLinear { weights, bias: values(&self.bias)? })
    }
}

impl PackedLinear {
    /// The layer on `map.num_outputs` rows; `residual` is added where there is one.
    ///
    /// # Shapes
    /// `x` `[N, inputs]`, `residual` and `out` `[N, outputs]`; `map` is [`KernelMap::identity`] of N.
    pub fn forward(&self, x: &[f32], map: &KernelMap, residual: Option<&[f32]>, out: &mut [f32]) {
        let epilogue = Epilogue { bias: Some(&self.bias), residual, relu: false };
        convolve_into(x, &self.weights, map, &epilogue, out);
    }

    /// As [`PackedLinear::forward`], then what is below zero set to zero.
    pub fn forward_relu(&self, x: &[f32], map: &KernelMap, out: &mut [f32]) {
        convolve_into(x, &self.weights, map, &Epilogue { bias: Some(&self.bias), residual: None, relu: true }, out);
    }

    /// Number of output channels.
    pub fn cout(&self) -> usize {
        self.bias.len()
    }
}
