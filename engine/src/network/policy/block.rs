//! A block: position encoding by a convolution, attention within patches, two dense layers.

use std::sync::Arc;

use candle_core::{Result, Tensor};
use candle_nn::{Init, VarBuilder};

use super::Trace;
use super::config::StageConfig;
use super::layers::{LayerNorm, Linear};
use crate::ops::activation::gelu;
use crate::ops::attention::{Patches, attention};
use crate::ops::sparse_conv::{KernelMap, convolve};

/// A convolution with bias.
#[derive(Clone, Debug)]
pub(super) struct Conv {
    pub(super) weight: Tensor,
    pub(super) bias: Tensor,
}

/// The trainable block.
#[derive(Clone, Debug)]
pub(super) struct Block {
    pub(super) conv: Conv,
    pub(super) position: Linear,
    pub(super) position_norm: LayerNorm,
    pub(super) attention_norm: LayerNorm,
    pub(super) qkv: Linear,
    pub(super) projection: Linear,
    pub(super) mlp_norm: LayerNorm,
    pub(super) expand: Linear,
    pub(super) contract: Linear,
    pub(super) num_heads: usize,
}

impl Conv {
    fn new(kernel: usize, cin: usize, cout: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let reach = 1.0 / ((kernel.pow(3) * cin) as f64).sqrt();
        let init = Init::Uniform { lo: -reach, up: reach };
        Ok(Self {
            weight: vb.get_with_hints((cout, kernel, kernel, kernel, cin), "weight", init)?,
            bias: vb.get_with_hints(cout, "bias", init)?,
        })
    }
}

impl Block {
    /// Makes or loads a block, by the names of the reference.
    pub(super) fn new(stage: &StageConfig, mlp_ratio: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let StageConfig { channels, heads, .. } = *stage;
        let hidden = channels * mlp_ratio;
        Ok(Self {
            conv: Conv::new(3, channels, channels, &vb.pp("cpe.0"))?,
            position: Linear::new(channels, channels, &vb.pp("cpe.1"))?,
            position_norm: LayerNorm::new(channels, &vb.pp("cpe.2"))?,
            attention_norm: LayerNorm::new(channels, &vb.pp("norm1.0"))?,
            qkv: Linear::new(channels, 3 * channels, &vb.pp("attn.qkv"))?,
            projection: Linear::new(channels, channels, &vb.pp("attn.proj"))?,
            mlp_norm: LayerNorm::new(channels, &vb.pp("norm2.0"))?,
            expand: Linear::new(channels, hidden, &vb.pp("mlp.0.fc1"))?,
            contract: Linear::new(hidden, channels, &vb.pp("mlp.0.fc2"))?,
            num_heads: heads,
        })
    }

    /// The block's result, differentiable. `[M, C]` to `[M, C]`; the convolution reads `seen` instead of `x`.
    pub(super) fn forward(
        &self,
        [x, seen]: [&Tensor; 2],
        map: &Arc<KernelMap>,
        patches: &Arc<Patches>,
        trace: &mut Trace<'_>,
    ) -> Result<Tensor> {
        let position = convolve(seen, &self.conv.weight, map)?.broadcast_add(&self.conv.bias)?;
        let position = self.position_norm.forward(&self.position.forward(&position)?)?;
        trace.note("cpe", &position)?;
        let x = (x + position)?;
        let qkv = self.qkv.forward(&self.attention_norm.forward(&x)?)?;
        let attended = self.projection.forward(&attention(&qkv, self.num_heads, patches)?)?;
        trace.note("attn", &attended)?;
        let x = (x + attended)?;
        let hidden = gelu(&self.expand.forward(&self.mlp_norm.forward(&x)?)?)?;
        x + self.contract.forward(&hidden)?
    }
}
