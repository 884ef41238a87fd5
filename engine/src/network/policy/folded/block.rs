//! A block in two passes over memory: the convolution, and everything else group of patches by group of patches.

use candle_core::Result;
use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::{Norm, PackedLinear};
use crate::network::policy::block::{Block, Conv};
use crate::network::policy::layers::{LAYER_EPS, Linear, singles};
use crate::ops::activation::gelu_in_place;
use crate::ops::attention::{self, Attend, Group, Heads, Patches, rows_by_group};
use crate::ops::dense::{self, Packed, Product, Rows, Store};
use crate::ops::lanes::Lines;
use crate::ops::norm::normalise_row;
use crate::ops::sparse_conv::{Epilogue, KernelMap, PackedWeights, convolve_into};

/// The block as inference runs it.
#[derive(Clone, Debug)]
pub(super) struct FoldedBlock {
    /// The convolution and the dense layer behind it in one.
    conv: PackedWeights,
    conv_bias: Vec<f32>,
    position_norm: Norm,
    attention_norm: Norm,
    qkv: PackedLinear,
    projection: PackedLinear,
    mlp_norm: Norm,
    expand: PackedLinear,
    contract: PackedLinear,
    heads: Heads,
}

impl FoldedBlock {
    pub(super) fn new(block: &Block) -> Result<Self> {
        let (conv, conv_bias) = merged(&block.conv, &block.position)?;
        Ok(Self {
            heads: Heads::new(conv_bias.len(), block.num_heads)?,
            conv,
            conv_bias,
            position_norm: Norm::new(&block.position_norm)?,
            attention_norm: Norm::new(&block.attention_norm)?,
            qkv: PackedLinear::new(&block.qkv)?,
            projection: PackedLinear::new(&block.projection)?,
            mlp_norm: Norm::new(&block.mlp_norm)?,
            expand: PackedLinear::new(&block.expand)?,
            contract: PackedLinear::new(&block.contract)?,
        })
    }

    /// The position encoding before its normalisation: `seen` `[M, C]` to `position` `[M, C]`.
    pub(super) fn convolve(&self, seen: &[f32], map: &KernelMap, position: &mut [f32]) {
        let epilogue = Epilogue { bias: Some(&self.conv_bias), ..Epilogue::default() };
        convolve_into(seen, &self.conv, map, &epilogue, position);
    }

    /// Replaces `x` `[M, C]` by the block's result, given what [`FoldedBlock::convolve`] made.
    pub(super) fn finish(&self, x: &mut [f32], patches: &Patches, position: &[f32]) {
        let arch = pulp::Arch::new();
        let groups: Vec<_> = patches.groups().zip(rows_by_group(x, self.heads.channels(), patches)).collect();
        groups.into_par_iter().for_each_init(Scratch::default, |scratch, (group, mut x)| {
            let rows = &patches.rows()[group.first()..group.end()];
            arch.dispatch(GroupPass { block: self, position, rows, group, x: &mut x, scratch });
        });
    }
}

/// `linear(conv(x) + b_c) + b_l` as one convolution and its bias.
fn merged(conv: &Conv, linear: &Linear) -> Result<(PackedWeights, Vec<f32>)> {
    let (inner, kernel, _, _, cin) = conv.weight.dims5()?;
    let (outputs, _) = linear.weight.dims2()?;
    let per_channel = kernel.pow(3) * cin;
    let (conv_weight, weight) = (singles(&conv.weight)?, singles(&linear.weight)?);
    let packed = Packed::new(inner, per_channel, |c, column| conv_weight[c * per_channel + column]);
    let mut product = vec![0.0_f32; outputs * per_channel];
    dense::multiply_into(&weight, &packed, &[], &mut product);
    let mut bias = vec![0.0_f32; outputs];
    let inner_bias = singles(&conv.bias)?;
    let layer = PackedLinear::new(linear)?;
    dense::multiply_into(&inner_bias, &layer.weights, &layer.bias, &mut bias);
    Ok((PackedWeights::of_checkpoint(&product, kernel.pow(3), cin, outputs), bias))
}

/// Memory that is used again for every group.
#[derive(Debug, Default)]
struct Scratch {
    x: Lines,
    narrow: Lines,
    wide: Lines,
    attention: attention::Scratch,
}

/// Everything behind the convolution, for the rows of one group.
struct GroupPass<'a> {
    block: &'a FoldedBlock,
    /// `[M, C]` results of the convolution.
    position: &'a [f32],
    /// Rows of the group along the curve.
    rows: &'a [u32],
    group: Group<'a>,
    /// Features of those rows.
    x: &'a mut [&'a mut [f32]],
    scratch: &'a mut Scratch,
}

impl WithSimd for GroupPass<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { block, position, rows, group, x: rows_of_x, scratch } = self;
        let (channels, count) = (block.heads.channels(), rows.len());
        let hidden = block.expand.bias.len();
        let Scratch { x, narrow, wide, attention } = scratch;
        x.resize(count * channels);
        narrow.resize(count * channels);
        wide.resize(count * hidden.max(3 * channels));

        let places = x.chunks_exact_mut(channels).zip(narrow.chunks_exact_mut(channels));
        for ((x, narrow), (row, source)) in places.zip(rows.iter().zip(rows_of_x.iter())) {
            let position = &position[*row as usize * channels..][..channels];
            normalise_row(simd, position, block.position_norm.parameters(), LAYER_EPS, narrow);
            x.iter_mut().zip(source.iter()).zip(narrow.iter()).for_each(|((x, s), p)| *x = s + p);
            normalise_row(simd, x, block.attention_norm.parameters(), LAYER_EPS, narrow);
        }

        product(simd, narrow, &block.qkv, wide, Store::Replace);
        for patch in group.patches {
            let keys = &wide[(patch.first_key - group.first()) * 3 * channels..][..patch.num_keys() * 3 * channels];
            let out =
                &mut narrow[(patch.first_query - group.first()) * channels..(patch.end - group.first()) * channels];
            let first_query = patch.first_query - patch.first_key;
            simd.vectorize(Attend { qkv: keys, heads: block.heads, first_query, scratch: attention, out });
        }
        product(simd, narrow, &block.projection, x, Store::Add);

        for (x, narrow) in x.chunks_exact(channels).zip(narrow.chunks_exact_mut(channels)) {
            normalise_row(simd, x, block.mlp_norm.parameters(), LAYER_EPS, narrow);
        }
        product(simd, narrow, &block.expand, wide, Store::Replace);
        gelu_in_place(simd, &mut wide[..count * hidden]);
        product(simd, &wide[..count * hidden], &block.contract, x, Store::Add);
        rows_of_x.iter_mut().zip(x.chunks_exact(channels)).for_each(|(to, x)| to.copy_from_slice(x));
    }
}

/// A dense layer on all rows of `a`.
#[inline(always)]
pub(super) fn product<S: Simd>(simd: S, a: &[f32], layer: &PackedLinear, out: &mut [f32], store: Store) {
    let (depth, columns) = (layer.weights.depth(), layer.weights.columns());
    let rows = Rows { values: a, stride: depth, count: a.len() / depth };
    simd.vectorize(Product { rows, packed: &layer.weights, bias: &layer.bias, out, out_stride: columns, store });
}
