//! One patch, head after head.

use candle_core::Result;
use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::patches::{Patch, Patches, rows_by_group};
use crate::ops::dense::{Packed, Product, Rows, Store};
use crate::ops::lanes::{Lines, exp2};

/// Queries whose scores are in cache together.
const QUERIES: usize = 48;
/// Rows of scores start on a multiple of this.
const ALIGN: usize = 32;

/// How channels are divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Heads {
    count: usize,
    width: usize,
}

impl Heads {
    /// # Errors
    /// When `count` does not divide `channels`.
    pub(crate) fn new(channels: usize, count: usize) -> Result<Self> {
        if channels == 0 || count == 0 || !channels.is_multiple_of(count) {
            candle_core::bail!(
                "attention: expected a number of heads that divides the channels, found {count} for {channels}"
            );
        }
        Ok(Self { count, width: channels / count })
    }

    pub(crate) fn count(self) -> usize {
        self.count
    }

    /// Channels of one head.
    pub(crate) fn width(self) -> usize {
        self.width
    }

    pub(crate) fn channels(self) -> usize {
        self.count * self.width
    }

    /// What scores are multiplied by before a power of 2 is taken.
    pub(crate) fn log2_scale(self) -> f32 {
        std::f32::consts::LOG2_E * self.scale()
    }

    pub(crate) fn scale(self) -> f32 {
        1.0 / (self.width as f32).sqrt()
    }
}

/// Memory that is used again for every patch.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    keys: Packed,
    values: Packed,
    scores: Lines,
    sums: Vec<f32>,
}

/// Attention of one patch.
#[derive(Debug)]
pub(crate) struct Attend<'a> {
    /// `[num_keys, 3 C]` rows of the patch's keys, the queries among them.
    pub(crate) qkv: &'a [f32],
    pub(crate) heads: Heads,
    /// The first row that is a query; all after it are.
    pub(crate) first_query: usize,
    pub(crate) scratch: &'a mut Scratch,
    /// `[num_queries, C]`.
    pub(crate) out: &'a mut [f32],
}

impl WithSimd for Attend<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { qkv, heads, first_query, scratch, out } = self;
        let (channels, width) = (heads.channels(), heads.width());
        let stride = 3 * channels;
        let num_keys = qkv.len() / stride;
        for head in 0..heads.count() {
            let column = head * width;
            scratch.keys.fill(width, num_keys, |d, key| qkv[key * stride + channels + column + d]);
            scratch.values.fill(num_keys, width, |key, d| qkv[key * stride + 2 * channels + column + d]);
            for first in (first_query..num_keys).step_by(QUERIES) {
                let count = QUERIES.min(num_keys - first);
                let queries = Rows { values: &qkv[first * stride + column..], stride, count };
                let score_stride = scores(simd, queries, num_keys, scratch, heads.log2_scale());
                let out = &mut out[(first - first_query) * channels + column..];
                let weights = Rows { values: &scratch.scores, stride: score_stride, count };
                simd.vectorize(Product {
                    rows: weights,
                    packed: &scratch.values,
                    bias: &[],
                    out: &mut *out,
                    out_stride: channels,
                    store: Store::Replace,
                });
                for (out, sum) in out.chunks_mut(channels).zip(&scratch.sums) {
                    let share = 1.0 / sum;
                    out[..width].iter_mut().for_each(|v| *v *= share);
                }
            }
        }
    }
}

/// Fills `scratch.scores` with the exponentials of the queries' scores and `scratch.sums` with their sums; the stride of the scores.
#[inline(always)]
fn scores<S: Simd>(simd: S, queries: Rows<'_>, num_keys: usize, scratch: &mut Scratch, scale: f32) -> usize {
    let stride = num_keys.next_multiple_of(ALIGN);
    scratch.scores.resize(queries.count * stride);
    simd.vectorize(Product {
        rows: queries,
        packed: &scratch.keys,
        bias: &[],
        out: &mut scratch.scores,
        out_stride: stride,
        store: Store::Replace,
    });
    scratch.sums.clear();
    for row in scratch.scores.chunks_exact_mut(stride) {
        scratch.sums.push(exponentials(simd, row, num_keys, scale));
    }
    stride
}

/// Replaces the first `count` values by `2^(scale (value - largest))`; their sum. What follows is filled with about 0.
#[inline(always)]
pub(super) fn exponentials<S: Simd>(simd: S, row: &mut [f32], count: usize, scale: f32) -> f32 {
    row[count..].fill(f32::NEG_INFINITY);
    let row = S::as_mut_simd_f32s(row).0;
    // The second argument of the maximum is returned when it is NaN: what is no number reaches the sum.
    let largest = row.iter().fold(simd.splat_f32s(f32::NEG_INFINITY), |m, &v| simd.max_f32s(m, v));
    let shift = simd.splat_f32s(-scale * simd.reduce_max_f32s(largest));
    let scale = simd.splat_f32s(scale);
    let mut sum = simd.splat_f32s(0.0);
    for v in row {
        *v = exp2(simd, simd.mul_add_f32s(*v, scale, shift));
        sum = simd.add_f32s(sum, *v);
    }
    simd.reduce_sum_f32s(sum)
}

/// Attention of all patches: `qkv` `[N, 3 C]`, `out` `[N, C]`.
pub(super) fn attend_all(qkv: &[f32], heads: Heads, patches: &Patches, out: &mut [f32]) {
    let channels = heads.channels();
    let arch = pulp::Arch::new();
    let groups: Vec<_> = patches.groups().zip(rows_by_group(out, channels, patches)).collect();
    groups.into_par_iter().for_each_init(
        || (Scratch::default(), Vec::new(), Vec::new()),
        |(scratch, gathered, result), (group, mut out)| {
            for patch in group.patches {
                gather(qkv, 3 * channels, &patches.rows()[patch.first_key..patch.end], gathered);
                result.resize((patch.end - patch.first_query) * channels, 0.0);
                let first_query = patch.first_query - patch.first_key;
                arch.dispatch(Attend { qkv: gathered, heads, first_query, scratch, out: result });
                let out = &mut out[patch.first_query - group.first()..];
                out.iter_mut().zip(result.chunks_exact(channels)).for_each(|(out, row)| out.copy_from_slice(row));
            }
        },
    );
}

/// Copies rows one after the other.
pub(super) fn gather(values: &[f32], width: usize, rows: &[u32], to: &mut Vec<f32>) {
    to.clear();
    rows.iter().for_each(|&row| to.extend_from_slice(&values[row as usize * width..][..width]));
}

/// The keys of a patch, counted from the first position of its group.
pub(super) fn keys_in_group(patch: &Patch, first: usize) -> std::ops::Range<usize> {
    patch.first_key - first..patch.end - first
}
