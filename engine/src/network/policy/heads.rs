//! The heads: from features to the two scores.

use candle_core::{Result, Tensor};
use candle_nn::VarBuilder;

use super::config::PolicyConfig;
use crate::network::linear::{Linear, by_pieces};
use crate::network::norm::LayerNorm;
use crate::ops::activation::gelu_owned;

/// Hidden blocks of a dense layer, normalisation and GELU, then one value.
#[derive(Clone, Debug)]
pub(super) struct Head {
    blocks: Vec<(Linear, LayerNorm)>,
    last: Linear,
}

impl Head {
    /// Makes or loads `blocks.B.{linear, norm}` and `last`, which starts at zero: a score of 1/2 until it is trained.
    pub(super) fn new(config: &PolicyConfig, vb: &VarBuilder<'_>) -> Result<Self> {
        let mut width = config.width();
        let mut blocks = Vec::with_capacity(config.head_blocks);
        for i in 0..config.head_blocks {
            let vb = vb.pp("blocks").pp(i);
            let linear = Linear::new(width, config.head_width, &vb.pp("linear"))?;
            blocks.push((linear, LayerNorm::new(config.head_width, &vb.pp("norm"))?));
            width = config.head_width;
        }
        Ok(Self { blocks, last: Linear::zero(width, 1, &vb.pp("last"))? })
    }

    /// The score before the sigmoid, `[M, C]` to `[M, 1]`.
    pub(super) fn forward(&self, x: &Tensor) -> Result<Tensor> {
        by_pieces([x], |[x]| {
            let mut x = x.clone();
            for (linear, norm) in &self.blocks {
                x = gelu_owned(norm.forward(&linear.forward(&x)?)?)?;
            }
            self.last.forward(&x)
        })
    }

    /// The head as inference runs it.
    pub(super) fn fold(&self) -> Result<Self> {
        let blocks = self.blocks.iter().map(|(linear, norm)| Ok((linear.fold()?, norm.clone())));
        Ok(Self { blocks: blocks.collect::<Result<_>>()?, last: self.last.fold()? })
    }
}
