//! Gradients by weights and bias: sums over all rows, in f64 over pieces of fixed size.

use pulp::{Simd, WithSimd};

use super::kernel::PANEL;
use crate::parallel;

/// Rows of one piece of work: fixed, so that results do not depend on the number of threads.
const PIECE: usize = 1 << 13;
/// Rows whose products are summed in f32 before they are added in f64.
const SHORT: usize = 256;

/// Gradient by the weights `[outputs, inputs]` and by the bias `[outputs]`.
///
/// # Shapes
/// `x` `[N, inputs]`, `v_out` `[N, outputs]`.
pub(super) fn by_parameters(x: &[f32], v_out: &[f32], inputs: usize, outputs: usize) -> (Vec<f32>, Vec<f32>) {
    let size = PIECE * outputs;
    let pieces = parallel::map(v_out.len().div_ceil(size), 1, &|piece| {
        let v_out = &v_out[piece * size..v_out.len().min((piece + 1) * size)];
        let x = &x[piece * PIECE * inputs..][..v_out.len() / outputs * inputs];
        let mut sums = OuterSums::new(inputs, outputs);
        pulp::Arch::new().dispatch(AddRows { x, v_out, sums: &mut sums });
        (sums.weights, sums.bias)
    });
    let (mut weights, mut bias) = (vec![0.0; inputs * outputs], vec![0.0; outputs]);
    for (w, b) in pieces {
        weights.iter_mut().zip(w).for_each(|(sum, v)| *sum += v);
        bias.iter_mut().zip(b).for_each(|(sum, v)| *sum += v);
    }
    (weights.into_iter().map(single).collect(), bias.into_iter().map(single).collect())
}

#[derive(Debug)]
struct OuterSums {
    inputs: usize,
    outputs: usize,
    /// `[outputs, inputs]`.
    weights: Vec<f64>,
    /// `[outputs]`.
    bias: Vec<f64>,
}

impl OuterSums {
    fn new(inputs: usize, outputs: usize) -> Self {
        Self { inputs, outputs, weights: vec![0.0; inputs * outputs], bias: vec![0.0; outputs] }
    }
}

struct AddRows<'a> {
    x: &'a [f32],
    v_out: &'a [f32],
    sums: &'a mut OuterSums,
}

impl WithSimd for AddRows<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { x, v_out, sums } = self;
        let (inputs, outputs) = (sums.inputs, sums.outputs);
        for row in v_out.chunks_exact(outputs) {
            sums.bias.iter_mut().zip(row).for_each(|(sum, &v)| *sum += f64::from(v));
        }
        // Columns of x in panels, copied once so that the loop below reads whole vectors.
        let mut panel = vec![0.0_f32; SHORT * PANEL];
        for (x, v_out) in x.chunks(SHORT * inputs).zip(v_out.chunks(SHORT * outputs)) {
            for first in (0..inputs).step_by(PANEL) {
                let width = PANEL.min(inputs - first);
                for (to, from) in panel.chunks_exact_mut(PANEL).zip(x.chunks_exact(inputs)) {
                    to[..width].copy_from_slice(&from[first..first + width]);
                }
                let rows = v_out.len() / outputs;
                match S::F32_LANES {
                    16 => outer::<S, 12, 2>(simd, sums, &panel[..rows * PANEL], v_out, first),
                    8 => outer::<S, 3, 4>(simd, sums, &panel[..rows * PANEL], v_out, first),
                    4 => outer::<S, 3, 8>(simd, sums, &panel[..rows * PANEL], v_out, first),
                    _ => outer::<S, 1, PANEL>(simd, sums, &panel[..rows * PANEL], v_out, first),
                }
            }
        }
    }
}

/// Adds `v_out^T panel` to the columns from `first` on.
#[inline(always)]
fn outer<S: Simd, const R: usize, const V: usize>(
    simd: S,
    sums: &mut OuterSums,
    panel: &[f32],
    v_out: &[f32],
    first: usize,
) {
    let (inputs, outputs) = (sums.inputs, sums.outputs);
    let width = PANEL.min(inputs - first);
    let panel = S::as_simd_f32s(panel).0.as_chunks::<V>().0;
    for output in (0..outputs).step_by(R) {
        let count = R.min(outputs - output);
        let mut acc = [[simd.splat_f32s(0.0); V]; R];
        for (x, v_out) in panel.iter().zip(v_out.chunks_exact(outputs)) {
            // The last group reads its last column again and drops it.
            let v_out = &v_out[output..output + count];
            for (r, acc) in acc.iter_mut().enumerate() {
                let value = simd.splat_f32s(v_out[r.min(count - 1)]);
                for (acc, &x) in acc.iter_mut().zip(x) {
                    *acc = simd.mul_add_f32s(value, x, *acc);
                }
            }
        }
        for (r, acc) in acc.iter().enumerate().take(count) {
            let values: &[f32] = bytemuck::cast_slice(acc);
            let sums = &mut sums.weights[(output + r) * inputs + first..][..width];
            sums.iter_mut().zip(values).for_each(|(sum, &v)| *sum += f64::from(v));
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "gradients are stored in f32")]
fn single(value: f64) -> f32 {
    value as f32
}
