//! A block: position encoding by a convolution, attention within patches, two dense layers.

use std::sync::Arc;

use candle_core::{Result, Tensor};
use candle_nn::{Init, VarBuilder};

use super::Trace;
use super::config::StageConfig;
use crate::network::conv::ConvSize;
use crate::network::linear::Linear;
use crate::network::norm::LayerNorm;
use crate::ops::activation::gelu;
use crate::ops::attention::{BlockLayers, Patches, attention};
use crate::ops::dense::{Layer, linear};
use crate::ops::sparse_conv::{ConvWeights, KernelMap, convolve};

/// The block.
#[derive(Clone, Debug)]
pub(super) struct Block {
    position: Position,
    rest: Rest,
}

/// A convolution and a dense layer behind it, which are one convolution.
#[derive(Clone, Debug)]
enum Position {
    Parts { weight: Tensor, bias: Tensor, linear: Linear },
    Folded(ConvWeights),
}

/// What stands behind the convolution.
#[derive(Clone, Debug)]
enum Rest {
    /// Operations with gradients.
    Operations(Box<Operations>),
    /// The same in one pass over memory.
    Folded(Arc<BlockLayers>),
}

#[derive(Clone, Debug)]
struct Operations {
    position_norm: LayerNorm,
    attention_norm: LayerNorm,
    qkv: Linear,
    projection: Linear,
    mlp_norm: LayerNorm,
    expand: Linear,
    contract: Linear,
    num_heads: usize,
}

impl Block {
    /// Makes or loads a block, by the names of the reference.
    pub(super) fn new(stage: &StageConfig, mlp_ratio: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let StageConfig { channels, heads, .. } = *stage;
        let hidden = channels * mlp_ratio;
        let (size, conv) = (ConvSize { kernel: 3, cin: channels, cout: channels }, vb.pp("cpe.0"));
        let reach = 1.0 / size.fan_in().sqrt();
        let init = Init::Uniform { lo: -reach, up: reach };
        let position = Position::Parts {
            weight: size.weight(init, &conv)?,
            bias: conv.get_with_hints(channels, "bias", init)?,
            linear: Linear::new(channels, channels, &vb.pp("cpe.1"))?,
        };
        let rest = Operations {
            position_norm: LayerNorm::new(channels, &vb.pp("cpe.2"))?,
            attention_norm: LayerNorm::new(channels, &vb.pp("norm1.0"))?,
            qkv: Linear::new(channels, 3 * channels, &vb.pp("attn.qkv"))?,
            projection: Linear::new(channels, channels, &vb.pp("attn.proj"))?,
            mlp_norm: LayerNorm::new(channels, &vb.pp("norm2.0"))?,
            expand: Linear::new(channels, hidden, &vb.pp("mlp.0.fc1"))?,
            contract: Linear::new(hidden, channels, &vb.pp("mlp.0.fc2"))?,
            num_heads: heads,
        };
        Ok(Self { position, rest: Rest::Operations(Box::new(rest)) })
    }

    /// The position encoding of features, before its normalisation. `[M, C]` to `[M, C]`.
    pub(super) fn encode(&self, seen: &Tensor, map: &Arc<KernelMap>) -> Result<Tensor> {
        convolve(seen, &self.position.weights()?, None, map, false)
    }

    /// The block's result `[M, C]` of `x` `[M, C]` and the position encoding, whose memory it takes where no gradient is asked for.
    pub(super) fn finish(
        &self,
        x: &Tensor,
        position: Tensor,
        patches: &Arc<Patches>,
        trace: &mut Trace<'_>,
    ) -> Result<Tensor> {
        match &self.rest {
            Rest::Operations(operations) => operations.forward(x, &position, patches, trace),
            Rest::Folded(layers) => layers.forward(x, position, patches),
        }
    }

    /// The block as inference runs it, to the bit what it is.
    pub(super) fn fold(&self) -> Result<Self> {
        let rest = match &self.rest {
            Rest::Operations(operations) => Arc::new(operations.layers()?),
            Rest::Folded(layers) => layers.clone(),
        };
        Ok(Self { position: Position::Folded(self.position.weights()?.detach()), rest: Rest::Folded(rest) })
    }
}

impl Position {
    /// `linear(conv(x) + b_c) + b_l` as one convolution and its bias.
    ///
    /// # Gradient
    /// By all tensors of both.
    fn weights(&self) -> Result<ConvWeights> {
        match self {
            Self::Folded(weights) => Ok(weights.clone()),
            Self::Parts { weight: conv, bias, linear: layer } => {
                let [weight, layer_bias] = layer.tensors()?;
                let (inner, k0, k1, k2, cin) = conv.dims5()?;
                let flat = conv.reshape((inner, k0 * k1 * k2 * cin))?.t()?;
                let none = Tensor::zeros(flat.dim(0)?, flat.dtype(), flat.device())?;
                let merged = linear(weight, &flat, &none)?.reshape((weight.dim(0)?, k0, k1, k2, cin))?;
                let bias = linear(&bias.unsqueeze(0)?, weight, layer_bias)?.squeeze(0)?;
                ConvWeights::with_bias(&merged, &bias)
            }
        }
    }
}

impl Operations {
    fn forward(&self, x: &Tensor, position: &Tensor, patches: &Arc<Patches>, trace: &mut Trace<'_>) -> Result<Tensor> {
        let position = self.position_norm.forward(position)?;
        trace.note("cpe", &position)?;
        let x = (x + position)?;
        let qkv = self.qkv.forward(&self.attention_norm.forward(&x)?)?;
        let attended = self.projection.forward(&attention(&qkv, self.num_heads, patches)?)?;
        trace.note("attn", &attended)?;
        let x = (x + attended)?;
        let hidden = gelu(&self.expand.forward(&self.mlp_norm.forward(&x)?)?)?;
        x + self.contract.forward(&hidden)?
    }

    fn layers(&self) -> Result<BlockLayers> {
        let packed = |layer: &Linear| {
            let [weight, bias] = layer.tensors()?;
            Layer::new(weight, bias)
        };
        Ok(BlockLayers {
            position_norm: self.position_norm.row_norm()?,
            attention_norm: self.attention_norm.row_norm()?,
            qkv: packed(&self.qkv)?,
            projection: packed(&self.projection)?,
            mlp_norm: self.mlp_norm.row_norm()?,
            expand: packed(&self.expand)?,
            contract: packed(&self.contract)?,
            num_heads: self.num_heads,
        })
    }
}
