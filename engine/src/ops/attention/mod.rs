//! Attention inside patches of rows along a space-filling curve.
//!
//! One patch and head at a time: scores, softmax and weighted sums stay in the second-level cache. Groups of patches that share rows are
//! one piece of work, so every row is written by one thread.

mod block;
mod cpu;
mod gradient;
mod patches;
pub mod reference;

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Tensor};

pub use block::BlockLayers;
pub use patches::Patches;

use cpu::Heads;

use super::tensors::{slice, with_values};

/// Multi-head attention within patches.
///
/// # Shapes
/// `qkv` `[N, 3 C]` f32: queries, keys, values, each `[num_heads, C / num_heads]`; result `[N, C]`.
///
/// # Formula
/// `softmax(q k^T / sqrt(C / num_heads)) v` over the positions of each patch.
///
/// # Source
/// Wu et al., Point Transformer V3, 2024, section 4.2.
///
/// # Gradient
/// By `qkv`, exact; the patches are constant.
///
/// # Errors
/// When the shapes do not fit or the heads do not divide the channels.
pub fn attention(qkv: &Tensor, num_heads: usize, patches: &Arc<Patches>) -> Result<Tensor> {
    let (rows, width) = qkv.dims2()?;
    let heads = Heads::new(width / 3, num_heads)?;
    if width != 3 * heads.channels() || rows != patches.num_rows() {
        candle_core::bail!("attention: expected [{}, 3 C], found [{rows}, {width}]", patches.num_rows());
    }
    qkv.contiguous()?.apply_op1(AttentionOp { heads, patches: patches.clone() })
}

struct AttentionOp {
    heads: Heads,
    patches: Arc<Patches>,
}

impl CustomOp1 for AttentionOp {
    fn name(&self) -> &'static str {
        "patch-attention"
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let qkv = slice(storage, layout)?;
        let mut out = vec![0.0_f32; qkv.len() / 3];
        cpu::attend_all(qkv, self.heads, &self.patches, &mut out);
        Ok((CpuStorage::F32(out), Shape::from((self.patches.num_rows(), self.heads.channels()))))
    }

    fn bwd(&self, qkv: &Tensor, _result: &Tensor, v_out: &Tensor) -> Result<Option<Tensor>> {
        let v_qkv = with_values([qkv, v_out], |[qkv, v_out]| {
            let mut v_qkv = vec![0.0_f32; qkv.len()];
            gradient::by_qkv(qkv, v_out, self.heads, &self.patches, &mut v_qkv);
            Ok(v_qkv)
        })?;
        Tensor::from_vec(v_qkv, qkv.shape(), qkv.device()).map(Some)
    }
}

#[cfg(test)]
mod tests;
