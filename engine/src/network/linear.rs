//! Linear layers on points: the trainable form is candle's, inference multiplies by the kernels of the sparse convolution.

use candle_core::{Result, Tensor};
use candle_nn::{Init, Module, VarBuilder};

use crate::ops::sparse_conv::{Epilogue, KernelMap, PackedWeights, convolve_into};

/// How a layer's weights start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// All zero: the layer returns zeros until it is trained.
    Zero,
    /// Normal with variance `1 / cin`.
    Normal,
}

/// `x W^T + b`.
#[derive(Clone, Debug)]
pub struct Linear {
    inner: candle_nn::Linear,
    cin: usize,
    cout: usize,
}

/// A [`Linear`] with its weights packed.
#[derive(Clone, Debug)]
pub struct PackedLinear {
    weights: PackedWeights,
    bias: Option<Vec<f32>>,
    cout: usize,
}

impl Linear {
    /// Makes or loads `weight` `[cout, cin]` and, where asked for, `bias` `[cout]`.
    ///
    /// # Errors
    /// When the builder has no such tensor.
    pub fn new(cin: usize, cout: usize, start: Start, bias: bool, vb: &VarBuilder<'_>) -> Result<Self> {
        let init = match start {
            Start::Zero => Init::Const(0.0),
            Start::Normal => Init::Randn { mean: 0.0, stdev: (1.0 / cin.max(1) as f64).sqrt() },
        };
        let weight = vb.get_with_hints((cout, cin), "weight", init)?;
        let bias = bias.then(|| vb.get_with_hints(cout, "bias", Init::Const(0.0))).transpose()?;
        Ok(Self { inner: candle_nn::Linear::new(weight, bias), cin, cout })
    }

    /// The layer, differentiable. `[N, cin]` to `[N, cout]`.
    ///
    /// # Errors
    /// When the shape does not fit.
    pub fn forward(&self, x: &Tensor) -> Result<Tensor> {
        self.inner.forward(x)
    }

    /// The form that inference runs.
    ///
    /// # Errors
    /// When a tensor cannot be read.
    pub fn pack(&self) -> Result<PackedLinear> {
        let values = |t: &Tensor| t.flatten_all()?.to_vec1::<f32>();
        let weights = PackedWeights::of_checkpoint(&values(self.inner.weight())?, 1, self.cin, self.cout);
        Ok(PackedLinear { weights, bias: self.inner.bias().map(values).transpose()?, cout: self.cout })
    }
}

impl PackedLinear {
    /// The layer on `map.num_outputs` rows; `residual` is added where there is one.
    ///
    /// # Shapes
    /// `x` `[N, cin]`, `residual` and `out` `[N, cout]`; `map` is [`KernelMap::identity`] of N.
    pub fn forward(&self, x: &[f32], map: &KernelMap, residual: Option<&[f32]>, out: &mut [f32]) {
        let epilogue = Epilogue { bias: self.bias.as_deref(), residual, relu: false };
        convolve_into(x, &self.weights, map, &epilogue, out);
    }

    /// Number of output channels.
    pub fn cout(&self) -> usize {
        self.cout
    }
}
