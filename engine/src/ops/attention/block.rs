//! A block of a point transformer behind its position encoding, group of patches by group of patches: what lies between its layers stays in
//! the caches.

use candle_core::{CpuStorage, InplaceOp2, Layout, Result, Tensor};
use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::cpu::{self, Attend, Heads};
use super::patches::{Group, Patches, rows_by_group};
use crate::ops::activation::gelu_in_place;
use crate::ops::dense::{Layer, Store};
use crate::ops::lanes::Lines;
use crate::ops::norm::{RowNorm, normalise_row};
use crate::ops::tensors::{slice, slice_mut};

/// The layers of a block, packed; constants.
#[derive(Clone, Debug)]
pub struct BlockLayers {
    /// Of the position encoding.
    pub position_norm: RowNorm,
    /// Before the attention.
    pub attention_norm: RowNorm,
    /// Queries, keys and values.
    pub qkv: Layer,
    /// Behind the attention.
    pub projection: Layer,
    /// Before the two layers.
    pub mlp_norm: RowNorm,
    /// The first of them.
    pub expand: Layer,
    /// The second.
    pub contract: Layer,
    /// Attention heads, which divide the channels.
    pub num_heads: usize,
}

impl BlockLayers {
    /// The block's result, in the memory of `position`, which nobody else may hold.
    ///
    /// # Shapes
    /// `x` and `position`, the position encoding before its normalisation, `[N, C]` f32; result `[N, C]`.
    ///
    /// # Formula
    /// `x += norm(position)`, `x += projection(attention(qkv(norm(x))))`, `x += contract(gelu(expand(norm(x))))`, each to the bit what the
    /// operations by themselves make of it.
    ///
    /// # Source
    /// Wu et al., Point Transformer V3, 2024, section 4.3.
    ///
    /// # Errors
    /// When a shape does not fit, or a gradient is asked for: there is none.
    pub fn forward(&self, x: &Tensor, position: Tensor, patches: &Patches) -> Result<Tensor> {
        let channels = self.projection.bias.len();
        let heads = Heads::new(channels, self.num_heads)?;
        let expected = [patches.num_rows(), channels];
        if x.dims() != expected || position.dims() != expected || x.track_op() || position.track_op() {
            let found = [x, &position].map(Tensor::dims);
            candle_core::bail!("attention block: expected two constant {expected:?}, found {found:?}");
        }
        let position = position.contiguous()?;
        position.inplace_op2(&x.contiguous()?, &Block { layers: self, heads, patches })?;
        Ok(position)
    }
}

struct Block<'a> {
    layers: &'a BlockLayers,
    heads: Heads,
    patches: &'a Patches,
}

impl InplaceOp2 for Block<'_> {
    fn name(&self) -> &'static str {
        "attention-block"
    }

    fn cpu_fwd(
        &self,
        position: &mut CpuStorage,
        position_layout: &Layout,
        x: &CpuStorage,
        x_layout: &Layout,
    ) -> Result<()> {
        let (rows, x) = (slice_mut(position, position_layout)?, slice(x, x_layout)?);
        let Self { layers, heads, patches } = *self;
        let arch = pulp::Arch::new();
        let groups: Vec<_> = patches.groups().zip(rows_by_group(rows, heads.channels(), patches)).collect();
        groups.into_par_iter().for_each_init(Scratch::default, |scratch, (group, mut rows)| {
            let indices = &patches.rows()[group.first()..group.end()];
            arch.dispatch(GroupPass { layers, heads, x, indices, group, rows: &mut rows, scratch });
        });
        Ok(())
    }
}

/// Memory that is used again for every group.
#[derive(Debug, Default)]
struct Scratch {
    x: Lines,
    narrow: Lines,
    wide: Lines,
    attention: cpu::Scratch,
}

/// Everything behind the convolution, for the rows of one group.
struct GroupPass<'a> {
    layers: &'a BlockLayers,
    heads: Heads,
    /// `[N, C]`.
    x: &'a [f32],
    /// Rows of the group along the curve.
    indices: &'a [u32],
    group: Group<'a>,
    /// Position encodings of those rows; afterwards the results.
    rows: &'a mut [&'a mut [f32]],
    scratch: &'a mut Scratch,
}

impl WithSimd for GroupPass<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { layers, heads, x: source, indices, group, rows, scratch } = self;
        let (channels, count) = (heads.channels(), indices.len());
        let hidden = layers.expand.bias.len();
        let Scratch { x, narrow, wide, attention } = scratch;
        x.resize(count * channels);
        narrow.resize(count * channels);
        wide.resize(count * hidden.max(3 * channels));

        let places = x.chunks_exact_mut(channels).zip(narrow.chunks_exact_mut(channels));
        for ((x, narrow), (&index, position)) in places.zip(indices.iter().zip(rows.iter())) {
            let source = &source[index as usize * channels..][..channels];
            normalise_row(simd, position, &layers.position_norm, narrow);
            x.iter_mut().zip(source).zip(narrow.iter()).for_each(|((x, s), p)| *x = s + p);
            normalise_row(simd, x, &layers.attention_norm, narrow);
        }

        layers.qkv.product(simd, narrow, wide, Store::Replace);
        for patch in group.patches {
            let keys = &wide[(patch.first_key - group.first()) * 3 * channels..][..patch.num_keys() * 3 * channels];
            let out =
                &mut narrow[(patch.first_query - group.first()) * channels..(patch.end - group.first()) * channels];
            let first_query = patch.first_query - patch.first_key;
            simd.vectorize(Attend { qkv: keys, heads, first_query, scratch: attention, out });
        }
        layers.projection.product(simd, narrow, x, Store::Add);

        for (x, narrow) in x.chunks_exact(channels).zip(narrow.chunks_exact_mut(channels)) {
            normalise_row(simd, x, &layers.mlp_norm, narrow);
        }
        layers.expand.product(simd, narrow, wide, Store::Replace);
        gelu_in_place(simd, &mut wide[..count * hidden]);
        layers.contract.product(simd, &wide[..count * hidden], x, Store::Add);
        rows.iter_mut().zip(x.chunks_exact(channels)).for_each(|(to, x)| to.copy_from_slice(x));
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use candle_core::{Device, Tensor};

    use super::BlockLayers;
    use crate::ops::activation::gelu;
    use crate::ops::attention::{Patches, attention};
    use crate::ops::dense::{Layer, linear};
    use crate::ops::norm::{RowNorm, layer_norm};
    use crate::ops::serialization::order;
    use crate::ops::test_support::values;

    const EPS: f32 = 1e-5;

    fn tensor(shape: &[usize], seed: u64) -> Tensor {
        Tensor::from_vec(values(shape.iter().product(), seed), shape, &Device::Cpu).unwrap()
    }

    /// The block as one pass and as operations one after the other.
    #[test]
    fn it_is_its_operations_to_the_bit() {
        for (rows, channels, num_heads, size) in [(1, 8, 2, 16), (70, 8, 1, 16), (300, 24, 3, 128), (500, 40, 2, 100)] {
            let codes: Vec<u64> = values(rows, 3).iter().map(|v| u64::from((v + 2.0).to_bits())).collect();
            let patches = Arc::new(Patches::new(order(&codes), &[rows], size).unwrap());
            let norm = |seed| [tensor(&[channels], seed), tensor(&[channels], seed + 1)];
            let layer = |cin: usize, cout: usize, seed| [tensor(&[cout, cin], seed), tensor(&[cout], seed + 1)];
            let [norm_p, norm_a, norm_m] = [10, 20, 30].map(norm);
            let (qkv, projection) = (layer(channels, 3 * channels, 40), layer(channels, channels, 50));
            let (expand, contract) = (layer(channels, 2 * channels, 60), layer(2 * channels, channels, 70));
            let row_norm = |[weight, bias]: &[Tensor; 2]| RowNorm::new(weight, bias, EPS).unwrap();
            let packed = |[weight, bias]: &[Tensor; 2]| Layer::new(weight, bias).unwrap();
            let layers = BlockLayers {
                position_norm: row_norm(&norm_p),
                attention_norm: row_norm(&norm_a),
                qkv: packed(&qkv),
                projection: packed(&projection),
                mlp_norm: row_norm(&norm_m),
                expand: packed(&expand),
                contract: packed(&contract),
                num_heads,
            };
            let (start, position) = (tensor(&[rows, channels], 1), tensor(&[rows, channels], 2));
            let normed = |x: &Tensor, [weight, bias]: &[Tensor; 2]| layer_norm(x, weight, bias, EPS).unwrap();
            let dense = |x: &Tensor, [weight, bias]: &[Tensor; 2]| linear(x, weight, bias).unwrap();
            let mut x = (&start + normed(&position, &norm_p)).unwrap();
            let attended = attention(&dense(&normed(&x, &norm_a), &qkv), num_heads, &patches).unwrap();
            x = (&x + dense(&attended, &projection)).unwrap();
            let hidden = gelu(&dense(&normed(&x, &norm_m), &expand)).unwrap();
            x = (&x + dense(&hidden, &contract)).unwrap();
            let got = layers.forward(&start, position, &patches).unwrap();
            assert_eq!(got.to_vec2::<f32>().unwrap(), x.to_vec2::<f32>().unwrap(), "{rows} rows of {channels}");
            assert!(layers.forward(&start.narrow(0, 0, rows - 1).unwrap(), start.copy().unwrap(), &patches).is_err());
        }
    }
}
