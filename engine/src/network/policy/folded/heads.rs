//! Both heads on blocks of rows.

use candle_core::Result;
use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::block::product;
use super::{Norm, PackedLinear};
use crate::network::policy::heads::Head;
use crate::network::policy::layers::LAYER_EPS;
use crate::ops::activation::gelu_in_place;
use crate::ops::dense::Store;
use crate::ops::lanes::Lines;
use crate::ops::norm::normalise_row;

/// Rows that one piece of work takes.
const BLOCK: usize = 256;

/// A head as inference runs it.
#[derive(Clone, Debug)]
pub(super) struct FoldedHead {
    blocks: Vec<(PackedLinear, Norm)>,
    last: PackedLinear,
}

impl FoldedHead {
    pub(super) fn new(head: &Head) -> Result<Self> {
        let blocks = head.blocks.iter().map(|(linear, norm)| Ok((PackedLinear::new(linear)?, Norm::new(norm)?)));
        Ok(Self { blocks: blocks.collect::<Result<_>>()?, last: PackedLinear::new(&head.last)? })
    }

    /// Channels of the features.
    fn inputs(&self) -> usize {
        self.blocks.first().map_or(&self.last, |(linear, _)| linear).weights.depth()
    }
}

/// The sigmoid of what the heads make of features `[M, C]`.
pub(super) fn scores(features: &[f32], heads: [&FoldedHead; 2]) -> Vec<[f32; 2]> {
    let inputs = heads[0].inputs();
    let mut scores = vec![[0.0_f32; 2]; features.len() / inputs];
    let arch = pulp::Arch::new();
    scores.par_chunks_mut(BLOCK).zip(features.par_chunks(BLOCK * inputs)).for_each_init(
        || [Lines::default(), Lines::default()],
        |scratch, (scores, x)| {
            for (i, head) in heads.into_iter().enumerate() {
                arch.dispatch(HeadBlock { head, x, scratch });
                for (score, logit) in scores.iter_mut().zip(scratch[0].iter()) {
                    score[i] = 1.0 / (1.0 + (-logit).exp());
                }
            }
        },
    );
    scores
}

/// One head on one block of rows; the logits lie in the first buffer afterwards.
struct HeadBlock<'a> {
    head: &'a FoldedHead,
    x: &'a [f32],
    scratch: &'a mut [Lines; 2],
}

impl WithSimd for HeadBlock<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { head, x, scratch: [a, b] } = self;
        let rows = x.len() / head.inputs();
        b.resize(x.len());
        b.copy_from_slice(x);
        for (linear, norm) in &head.blocks {
            let width = linear.bias.len();
            a.resize(rows * width);
            product(simd, b, linear, a, Store::Replace);
            b.resize(rows * width);
            for (from, to) in a.chunks_exact(width).zip(b.chunks_exact_mut(width)) {
                normalise_row(simd, from, norm.parameters(), LAYER_EPS, to);
            }
            gelu_in_place(simd, b);
        }
        a.resize(rows);
        product(simd, b, &head.last, a, Store::Replace);
    }
}
