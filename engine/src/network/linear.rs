//! Linear layers.

use std::sync::Arc;

use candle_core::{Result, Tensor};
use candle_nn::{Init, VarBuilder};

use crate::ops::dense::{self, Layer};
use crate::parallel;

/// Rows of one piece of work: fixed, so that results do not depend on the number of threads.
const PIECE: usize = 1024;

/// `x W^T + b`.
#[derive(Clone, Debug)]
pub struct Linear(Weights);

#[derive(Clone, Debug)]
enum Weights {
    /// As a checkpoint holds them.
    Tensors { weight: Tensor, bias: Tensor },
    /// As the kernel reads them, constant.
    Packed(Arc<Layer>),
}

impl Linear {
    /// Makes or loads `weight` `[outputs, inputs]` and `bias` `[outputs]`, uniform within `1 / sqrt(inputs)`.
    ///
    /// # Errors
    /// When the builder has no such tensor.
    pub fn new(inputs: usize, outputs: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let reach = 1.0 / (inputs as f64).sqrt();
        let init = Init::Uniform { lo: -reach, up: reach };
        let weight = vb.get_with_hints((outputs, inputs), "weight", init)?;
        Ok(Self::of(weight, vb.get_with_hints(outputs, "bias", init)?))
    }

    /// As [`Linear::new`], but zero until it is trained.
    ///
    /// # Errors
    /// As [`Linear::new`].
    pub fn zero(inputs: usize, outputs: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let bias = vb.get_with_hints(outputs, "bias", Init::Const(0.0))?;
        Ok(Self::of(vb.get_with_hints((outputs, inputs), "weight", Init::Const(0.0))?, bias))
    }

    /// As [`Linear::zero`], with a `bias` of constant zeros.
    ///
    /// # Errors
    /// As [`Linear::new`].
    pub(crate) fn zero_without_bias(inputs: usize, outputs: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let weight = vb.get_with_hints((outputs, inputs), "weight", Init::Const(0.0))?;
        let bias = Tensor::zeros(outputs, weight.dtype(), weight.device())?;
        Ok(Self::of(weight, bias))
    }

    /// The layer with this `weight` `[outputs, inputs]` and `bias` `[outputs]`.
    pub(in crate::network) fn of(weight: Tensor, bias: Tensor) -> Self {
        Self(Weights::Tensors { weight, bias })
    }

    /// Weight and bias.
    ///
    /// # Errors
    /// When they are packed.
    pub(in crate::network) fn tensors(&self) -> Result<[&Tensor; 2]> {
        match &self.0 {
            Weights::Tensors { weight, bias } => Ok([weight, bias]),
            Weights::Packed(_) => candle_core::bail!("linear: expected a layer that is not packed yet"),
        }
    }

    /// The layer. `[N, inputs]` to `[N, outputs]`.
    ///
    /// # Gradient
    /// By all tensors; a packed layer has none.
    ///
    /// # Errors
    /// When the shape does not fit.
    pub fn forward(&self, x: &Tensor) -> Result<Tensor> {
        match &self.0 {
            Weights::Tensors { weight, bias } => dense::linear(x, weight, bias),
            Weights::Packed(layer) => layer.forward(x),
        }
    }

    /// `onto`, which nobody else may hold, plus the layer on `x`.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub(crate) fn add_to(&self, onto: Tensor, x: &Tensor) -> Result<Tensor> {
        match &self.0 {
            Weights::Tensors { weight, bias } => onto + dense::linear(x, weight, bias)?,
            Weights::Packed(layer) => layer.add_to(onto, x),
        }
    }

    /// The layer, then `affine` `[2, outputs]` by output: its factors in the weights.
    ///
    /// # Errors
    /// When it is packed.
    pub(in crate::network) fn then_affine(&self, affine: &Tensor) -> Result<Self> {
        let [weight, bias] = self.tensors()?;
        let (factor, shift) = (affine.get(0)?, affine.get(1)?);
        Ok(Self::of(weight.broadcast_mul(&factor.unsqueeze(1)?)?, ((bias * factor)? + shift)?))
    }

    /// The layer as inference runs it: packed once, to the bit what it was.
    ///
    /// # Errors
    /// When a tensor cannot be read.
    pub fn fold(&self) -> Result<Self> {
        Ok(Self(Weights::Packed(match &self.0 {
            Weights::Tensors { weight, bias } => Arc::new(Layer::new(weight, bias)?),
            Weights::Packed(layer) => layer.clone(),
        })))
    }
}

/// What layers that treat every row alone make of rows. Where no gradient is asked for, piece by piece: what lies between the layers stays
/// in the caches and takes no memory worth mention.
///
/// # Shapes
/// `inputs` `[N, ..]`, all of as many rows.
///
/// # Errors
/// Those of the layers, and inputs that differ in their rows.
pub(in crate::network) fn by_pieces<const N: usize>(
    inputs: [&Tensor; N],
    layers: impl Fn([&Tensor; N]) -> Result<Tensor> + Sync,
) -> Result<Tensor> {
    let rows = inputs.first().map_or(Ok(0), |x| x.dim(0))?;
    if rows <= PIECE || inputs.iter().any(|x| x.track_op()) {
        return layers(inputs);
    }
    let piece = |k: usize| {
        let (first, count) = (k * PIECE, PIECE.min(rows - k * PIECE));
        let parts = inputs.iter().map(|x| x.narrow(0, first, count)).collect::<Result<Vec<Tensor>>>()?;
        layers(std::array::from_fn(|i| &parts[i]))
    };
    let pieces = parallel::map(rows.div_ceil(PIECE), 1, &piece).into_iter().collect::<Result<Vec<Tensor>>>()?;
    Tensor::cat(&pieces, 0)
}
