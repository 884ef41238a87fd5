//! Gradient by queries, keys and values: the scores are computed again.

use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::cpu::{Heads, exponentials, gather, keys_in_group};
use super::patches::{Patches, rows_by_group};
use crate::ops::dense::{Packed, Product, Rows, Store};

/// Fills `v_qkv` `[N, 3 C]` from `v_out` `[N, C]`.
pub(super) fn by_qkv(qkv: &[f32], v_out: &[f32], heads: Heads, patches: &Patches, v_qkv: &mut [f32]) {
    let channels = heads.channels();
    let stride = 3 * channels;
    let arch = pulp::Arch::new();
    let groups: Vec<_> = patches.groups().zip(rows_by_group(v_qkv, stride, patches)).collect();
    groups.into_par_iter().for_each_init(Scratch::default, |scratch, (group, mut v_qkv)| {
        let rows = &patches.rows()[group.first()..group.end()];
        let (mut own, mut gathered, mut by_out) = (vec![0.0_f32; rows.len() * stride], Vec::new(), Vec::new());
        for patch in group.patches {
            let keys = keys_in_group(patch, group.first());
            gather(qkv, stride, &rows[keys.clone()], &mut gathered);
            gather(v_out, channels, &rows[patch.first_query - group.first()..keys.end], &mut by_out);
            let first_query = patch.first_query - patch.first_key;
            let v_qkv = &mut own[keys.start * stride..keys.end * stride];
            arch.dispatch(PatchGradient { qkv: &gathered, v_out: &by_out, heads, first_query, scratch, v_qkv });
        }
        v_qkv.iter_mut().zip(own.chunks_exact(stride)).for_each(|(to, row)| to.copy_from_slice(row));
    });
}

#[derive(Debug, Default)]
struct Scratch {
    packed: Packed,
    /// `[queries, keys]` attention weights and gradients by the scores.
    weights: Vec<f32>,
    v_scores: Vec<f32>,
    /// `[keys, queries]`.
    transposed: Vec<f32>,
}

/// Adds the gradients of one patch to `v_qkv` `[num_keys, 3 C]`.
struct PatchGradient<'a> {
    qkv: &'a [f32],
    v_out: &'a [f32],
    heads: Heads,
    first_query: usize,
    scratch: &'a mut Scratch,
    v_qkv: &'a mut [f32],
}

impl WithSimd for PatchGradient<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        for head in 0..self.heads.count() {
            self.head(simd, head * self.heads.width());
        }
    }
}

impl PatchGradient<'_> {
    #[inline(always)]
    fn head<S: Simd>(&mut self, simd: S, column: usize) {
        let (channels, width) = (self.heads.channels(), self.heads.width());
        let stride = 3 * channels;
        let num_keys = self.qkv.len() / stride;
        let num_queries = num_keys - self.first_query;
        let (qkv, v_out) = (self.qkv, self.v_out);
        let Scratch { packed, weights, v_scores, transposed } = &mut *self.scratch;
        let queries = row(&qkv[self.first_query * stride + column..], stride, num_queries);
        let by_out = row(&v_out[column..], channels, num_queries);

        weights.resize(num_queries * num_keys, 0.0);
        packed.fill(width, num_keys, |d, key| qkv[key * stride + channels + column + d]);
        product(simd, queries, packed, weights, num_keys, Store::Replace);
        softmax(simd, weights, num_keys, self.heads.log2_scale());

        // v_scores = weights * (v_out V^T - its mean under the weights) / sqrt(width)
        v_scores.resize(num_queries * num_keys, 0.0);
        packed.fill(width, num_keys, |d, key| qkv[key * stride + 2 * channels + column + d]);
        product(simd, by_out, packed, v_scores, num_keys, Store::Replace);
        let scale = self.heads.scale();
        for (weights, v) in weights.chunks_exact(num_keys).zip(v_scores.chunks_exact_mut(num_keys)) {
            let mean: f32 = weights.iter().zip(v.iter()).map(|(w, v)| w * v).sum();
            v.iter_mut().zip(weights).for_each(|(v, w)| *v = w * (*v - mean) * scale);
        }

        // v_queries = v_scores K
        packed.fill(num_keys, width, |key, d| qkv[key * stride + channels + column + d]);
        let out = &mut self.v_qkv[self.first_query * stride + column..];
        product(simd, row(v_scores, num_keys, num_queries), packed, out, stride, Store::Add);

        // v_keys = v_scores^T Q
        transpose(v_scores, num_keys, transposed);
        packed.fill(num_queries, width, |query, d| qkv[(self.first_query + query) * stride + column + d]);
        let out = &mut self.v_qkv[channels + column..];
        product(simd, row(transposed, num_queries, num_keys), packed, out, stride, Store::Add);

        // v_values = weights^T v_out
        transpose(weights, num_keys, transposed);
        packed.fill(num_queries, width, |query, d| v_out[query * channels + column + d]);
        let out = &mut self.v_qkv[2 * channels + column..];
        product(simd, row(transposed, num_queries, num_keys), packed, out, stride, Store::Add);
    }
}

fn row(values: &[f32], stride: usize, count: usize) -> Rows<'_> {
    Rows { values, stride, count }
}

#[inline(always)]
fn product<S: Simd>(simd: S, rows: Rows<'_>, packed: &Packed, out: &mut [f32], out_stride: usize, store: Store) {
    simd.vectorize(Product { rows, packed, bias: &[], out, out_stride, store });
}

/// Replaces scores by attention weights, row by row.
#[inline(always)]
fn softmax<S: Simd>(simd: S, scores: &mut [f32], num_keys: usize, scale: f32) {
    let mut row = vec![0.0_f32; num_keys.next_multiple_of(64)];
    for scores in scores.chunks_exact_mut(num_keys) {
        row[..num_keys].copy_from_slice(scores);
        let share = 1.0 / exponentials(simd, &mut row, num_keys, scale);
        scores.iter_mut().zip(&row).for_each(|(to, &v)| *to = v * share);
    }
}

/// `[rows, columns]` to `[columns, rows]`.
#[inline(always)]
fn transpose(values: &[f32], columns: usize, to: &mut Vec<f32>) {
    let rows = values.len() / columns;
    to.resize(values.len(), 0.0);
    for (r, row) in values.chunks_exact(columns).enumerate() {
        for (c, &value) in row.iter().enumerate() {
            to[c * rows + r] = value;
        }
    }
}
