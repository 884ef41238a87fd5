//! The layers between stages, block of rows by block of rows.

use candle_core::Result;
use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::{PackedLinear, single};
use crate::network::buffers::Buffers;
use crate::network::policy::layers::{BatchNorm, Linear, doubles};
use crate::network::policy::resample::{Down, STEM_KERNEL, Stem, Up};
use crate::ops::activation::gelu_in_place;
use crate::ops::dense::Store;
use crate::ops::lanes::Lines;
use crate::ops::segment::Segments;
use crate::ops::sparse_conv::{Epilogue, KernelMap, PackedWeights, convolve_into};

/// Rows that one piece of work takes.
const BLOCK: usize = 128;

/// The stem with its normalisation folded into weights and bias.
#[derive(Clone, Debug)]
pub(super) struct FoldedStem {
    weights: PackedWeights,
    bias: Vec<f32>,
    inputs: usize,
}

/// The way down; its normalisation stands behind the maximum and stays.
#[derive(Clone, Debug)]
pub(super) struct FoldedDown {
    linear: PackedLinear,
    factor: Vec<f32>,
    shift: Vec<f32>,
}

/// The way up.
#[derive(Clone, Debug)]
pub(super) struct FoldedUp {
    coarse: PackedLinear,
    skip: PackedLinear,
}

impl FoldedStem {
    pub(super) fn new(stem: &Stem) -> Result<Self> {
        let (outputs, _, _, _, inputs) = stem.weight.dims5()?;
        let affine = stem.norm.fold()?;
        let per_output = STEM_KERNEL.pow(3) * inputs;
        let weight = doubles(&stem.weight)?;
        let scaled: Vec<f32> =
            weight.iter().enumerate().map(|(i, w)| single(w * affine.factor[i / per_output])).collect();
        Ok(Self {
            weights: PackedWeights::of_checkpoint(&scaled, STEM_KERNEL.pow(3), inputs, outputs),
            bias: affine.shift.into_iter().map(single).collect(),
            inputs,
        })
    }

    pub(super) fn inputs(&self) -> usize {
        self.inputs
    }

    pub(super) fn forward(&self, x: &[f32], map: &KernelMap, buffers: &mut Buffers) -> Vec<f32> {
        let mut out = buffers.take(map.num_outputs() * self.bias.len());
        let epilogue = Epilogue { bias: Some(&self.bias), ..Epilogue::default() };
        convolve_into(x, &self.weights, map, &epilogue, &mut out);
        let arch = pulp::Arch::new();
        out.par_chunks_mut(1 << 14).for_each(|values| arch.dispatch(Gelu(values)));
        out
    }
}

impl FoldedDown {
    pub(super) fn new(down: &Down) -> Result<Self> {
        let affine = down.norm.fold()?;
        let [factor, shift] = [affine.factor, affine.shift].map(|values| values.into_iter().map(single).collect());
        Ok(Self { linear: PackedLinear::new(&down.linear)?, factor, shift })
    }

    pub(super) fn forward(&self, x: &[f32], parents: &Segments, buffers: &mut Buffers) -> Vec<f32> {
        let channels = self.linear.weights.columns();
        let mut out = buffers.take(parents.num_segments() * channels);
        let arch = pulp::Arch::new();
        out.par_chunks_mut(BLOCK * channels).enumerate().for_each_init(
            || [Lines::default(), Lines::default()],
            |scratch, (block, out)| {
                arch.dispatch(Pool { layer: self, x, parents, first: block * BLOCK, scratch, out });
            },
        );
        out
    }
}

/// The largest values of a block of coarse voxels.
struct Pool<'a> {
    layer: &'a FoldedDown,
    x: &'a [f32],
    parents: &'a Segments,
    first: usize,
    scratch: &'a mut [Lines; 2],
    out: &'a mut [f32],
}

impl WithSimd for Pool<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { layer, x, parents, first, scratch: [members, products], out } = self;
        let (inputs, channels) = (layer.linear.weights.depth(), layer.linear.weights.columns());
        let segments = first..first + out.len() / channels;
        let count: usize = segments.clone().map(|segment| parents.members(segment).len()).sum();
        members.resize(count * inputs);
        products.resize(count * channels);
        let rows = segments.clone().flat_map(|segment| parents.members(segment));
        for (to, &row) in members.chunks_exact_mut(inputs).zip(rows) {
            to.copy_from_slice(&x[row as usize * inputs..][..inputs]);
        }
        product(simd, members, &layer.linear, products);
        let mut products = products.chunks_exact(channels);
        for (segment, out) in segments.zip(out.chunks_exact_mut(channels)) {
            out.fill(f32::NEG_INFINITY);
            for row in products.by_ref().take(parents.members(segment).len()) {
                // NaN wins: it must not be lost.
                out.iter_mut().zip(row).for_each(|(out, &v)| *out = if *out >= v || out.is_nan() { *out } else { v });
            }
            let affine = layer.factor.iter().zip(&layer.shift);
            out.iter_mut().zip(affine).for_each(|(out, (factor, shift))| *out = *out * factor + shift);
        }
        gelu_in_place(simd, out);
    }
}

impl FoldedUp {
    pub(super) fn new(up: &Up) -> Result<Self> {
        let fold = |(linear, norm): &(Linear, BatchNorm)| PackedLinear::with_affine(linear, &norm.fold()?);
        Ok(Self { coarse: fold(&up.coarse)?, skip: fold(&up.skip)? })
    }

    /// The parts of the sum: of the fine voxels and of the coarse ones, buffers of `buffers`.
    pub(super) fn forward(&self, x: &[f32], skip: &[f32], buffers: &mut Buffers) -> [Vec<f32>; 2] {
        [(&self.skip, skip), (&self.coarse, x)].map(|(layer, x)| {
            let (inputs, channels) = (layer.weights.depth(), layer.weights.columns());
            let mut out = buffers.take(x.len() / inputs * channels);
            let arch = pulp::Arch::new();
            let blocks = out.par_chunks_mut(BLOCK * channels).zip(x.par_chunks(BLOCK * inputs));
            blocks.for_each(|(out, x)| arch.dispatch(Lift { layer, x, out }));
            out
        })
    }
}

/// Adds the row of each row's parent.
pub(super) fn add_parents(x: &mut [f32], coarse: &[f32], parents: &Segments) {
    let channels = coarse.len() / parents.num_segments().max(1);
    if channels > 0 {
        x.par_chunks_exact_mut(channels).zip(parents.segment_of()).with_min_len(1024).for_each(|(x, &parent)| {
            x.iter_mut().zip(&coarse[parent as usize * channels..]).for_each(|(x, v)| *x += v);
        });
    }
}

struct Lift<'a> {
    layer: &'a PackedLinear,
    x: &'a [f32],
    out: &'a mut [f32],
}

impl WithSimd for Lift<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        product(simd, self.x, self.layer, self.out);
        gelu_in_place(simd, self.out);
    }
}

struct Gelu<'a>(&'a mut [f32]);

impl WithSimd for Gelu<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        gelu_in_place(simd, self.0);
    }
}

#[inline(always)]
fn product<S: Simd>(simd: S, a: &[f32], layer: &PackedLinear, out: &mut [f32]) {
    super::block::product(simd, a, layer, out, Store::Replace);
}
