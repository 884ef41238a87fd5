//! Gradient by the weights: sums of outer products over the pairs of each offset.

use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::map::{BLOCK, KernelMap};

/// Blocks of output rows whose sums are made by one piece of work: fixed, so that results do not depend on the number of threads.
const BLOCKS_PER_PIECE: usize = 64;
/// Pairs that are gathered and multiplied at a time; what they add up to in f32 is then added in f64.
const PAIRS: usize = 128;
/// Output channels and input channels are padded to multiples of these.
const COLUMNS: usize = 32;
const ROWS: usize = 8;

/// Gradient of a scalar by the weights, from its gradient by the output rows.
///
/// # Shapes
/// `features` `[num_inputs, cin]`, `v_out` `[num_outputs, cout]`; result `[cout, num_offsets, cin]`.
pub(super) fn by_weights(features: &[f32], v_out: &[f32], map: &KernelMap, cin: usize, cout: usize) -> Vec<f32> {
    let pieces = map.num_outputs.div_ceil(BLOCK).div_ceil(BLOCKS_PER_PIECE);
    let mut result = vec![0.0_f32; cout * map.num_offsets * cin];
    let sums: Vec<Vec<f64>> = (0..map.num_offsets)
        .into_par_iter()
        .map(|offset| {
            let parts: Vec<Vec<f64>> = (0..pieces)
                .into_par_iter()
                .map(|piece| OuterSums::new(cin, cout).over(features, v_out, map, offset, piece))
                .collect();
            parts.into_iter().reduce(add).unwrap_or_default()
        })
        .collect();
    let padded = cout.next_multiple_of(COLUMNS);
    for (offset, sums) in sums.iter().enumerate().filter(|(_, sums)| !sums.is_empty()) {
        for c in 0..cout {
            for k in 0..cin {
                result[(c * map.num_offsets + offset) * cin + k] = single(sums[k * padded + c]);
            }
        }
    }
    result
}

fn add(mut a: Vec<f64>, b: Vec<f64>) -> Vec<f64> {
    if a.is_empty() {
        return b;
    }
    a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
    a
}

/// Gathered rows and their sums, `[cin, cout]` padded.
struct OuterSums {
    cin: usize,
    cout: usize,
    left: Vec<f32>,
    right: Vec<f32>,
    count: usize,
    sums: Vec<f64>,
}

impl OuterSums {
    fn new(cin: usize, cout: usize) -> Self {
        Self { cin, cout, left: Vec::new(), right: Vec::new(), count: 0, sums: Vec::new() }
    }

    /// Sums of one offset over the blocks of one piece; empty when there is no pair.
    fn over(mut self, features: &[f32], v_out: &[f32], map: &KernelMap, offset: usize, piece: usize) -> Vec<f64> {
        let blocks = map.num_outputs.div_ceil(BLOCK);
        for block in piece * BLOCKS_PER_PIECE..((piece + 1) * BLOCKS_PER_PIECE).min(blocks) {
            let (inputs, outputs) = map.pairs(block, offset);
            for (&input, &output) in inputs.iter().zip(outputs) {
                let output = block * BLOCK + usize::from(output);
                self.push(
                    &features[input as usize * self.cin..][..self.cin],
                    &v_out[output * self.cout..][..self.cout],
                );
            }
        }
        self.flush();
        self.sums
    }

    fn push(&mut self, input: &[f32], v_output: &[f32]) {
        let (left, right) = (self.cin.next_multiple_of(ROWS), self.cout.next_multiple_of(COLUMNS));
        if self.left.is_empty() {
            self.left = vec![0.0; PAIRS * left];
            self.right = vec![0.0; PAIRS * right];
            self.sums = vec![0.0; left * right];
        }
        self.left[self.count * left..][..self.cin].copy_from_slice(input);
        self.right[self.count * right..][..self.cout].copy_from_slice(v_output);
        self.count += 1;
        if self.count == PAIRS {
            self.flush();
        }
    }

    fn flush(&mut self) {
        if self.count > 0 {
            pulp::Arch::new().dispatch(Flush(self));
            self.count = 0;
        }
    }

    #[inline(always)]
    fn multiply<S: Simd, const VECTORS: usize, const HEIGHT: usize>(&mut self, simd: S) {
        let (left, right) = (self.cin.next_multiple_of(ROWS), self.cout.next_multiple_of(COLUMNS));
        let gathered = S::as_simd_f32s(&self.right[..self.count * right]).0;
        let stride = right / S::F32_LANES;
        for column in (0..stride).step_by(VECTORS) {
            for first in (0..left).step_by(HEIGHT) {
                let mut acc = [[simd.splat_f32s(0.0); VECTORS]; HEIGHT];
                let rows = self.left[..self.count * left].chunks_exact(left).zip(gathered.chunks_exact(stride));
                for (row, values) in rows {
                    let (row, values) = (&row[first..first + HEIGHT], &values[column..column + VECTORS]);
                    for r in 0..HEIGHT {
                        let value = simd.splat_f32s(row[r]);
                        for v in 0..VECTORS {
                            acc[r][v] = simd.mul_add_f32s(value, values[v], acc[r][v]);
                        }
                    }
                }
                for (r, acc) in acc.iter().enumerate() {
                    let values: &[f32] = bytemuck::cast_slice(acc);
                    let sums = &mut self.sums[(first + r) * right + column * S::F32_LANES..];
                    sums.iter_mut().zip(values).for_each(|(s, &v)| *s += f64::from(v));
                }
            }
        }
    }
}

struct Flush<'a>(&'a mut OuterSums);

impl WithSimd for Flush<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match S::F32_LANES {
            16 => self.0.multiply::<S, 2, 8>(simd),
            8 => self.0.multiply::<S, 2, 4>(simd),
            4 => self.0.multiply::<S, 4, 4>(simd),
            _ => self.0.multiply::<S, 8, 4>(simd),
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "gradients are stored in f32")]
fn single(value: f64) -> f32 {
    value as f32
}
