//! Layer normalisation: every row by its own mean and variance.

use candle_core::{CpuStorage, CustomOp3, Layout, Result, Shape, Tensor};
use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::{checked, single};
use crate::ops::tensors::{slice, with_values};
use crate::parallel;

/// Rows of one piece of work: fixed, so that results do not depend on the number of threads.
const PIECE: usize = 1 << 10;

/// Rows brought to mean 0 and variance 1, then scaled and shifted.
///
/// # Shapes
/// `x` `[N, C]`, `weight` and `bias` `[C]`, all f32; result `[N, C]`.
///
/// # Formula
/// `(x - mean) / sqrt(var + eps) * weight + bias`, mean and (biased) variance over each row.
///
/// # Gradient
/// By all three, exact; sums over rows in f64.
///
/// # Errors
/// When a shape or dtype does not fit.
pub fn layer_norm(x: &Tensor, weight: &Tensor, bias: &Tensor, eps: f32) -> Result<Tensor> {
    let (_, width) = checked("layer norm", x, weight, bias)?;
    x.contiguous()?.apply_op3(&weight.contiguous()?, &bias.contiguous()?, LayerNorm { width, eps })
}

/// The parameters of a [`layer_norm`] as constants.
#[derive(Clone, Debug)]
pub struct RowNorm {
    weight: Vec<f32>,
    bias: Vec<f32>,
    eps: f32,
}

impl RowNorm {
    /// Copies `weight` and `bias` `[C]`.
    ///
    /// # Errors
    /// When a value cannot be read.
    pub fn new(weight: &Tensor, bias: &Tensor, eps: f32) -> Result<Self> {
        Ok(Self { weight: weight.to_vec1()?, bias: bias.to_vec1()?, eps })
    }
}

/// Normalises one row into `out`; all of one length.
#[inline(always)]
pub(crate) fn normalise_row<S: Simd>(simd: S, row: &[f32], norm: &RowNorm, out: &mut [f32]) {
    into(simd, row, [&norm.weight, &norm.bias], norm.eps, out);
}

#[inline(always)]
fn into<S: Simd>(simd: S, row: &[f32], [weight, bias]: [&[f32]; 2], eps: f32, out: &mut [f32]) {
    let (mean, scale) = moments(simd, row, eps);
    let (mean_lanes, scale_lanes) = (simd.splat_f32s(mean), simd.splat_f32s(scale));
    let (x, x_tail) = S::as_simd_f32s(row);
    let (w, w_tail) = S::as_simd_f32s(weight);
    let (b, b_tail) = S::as_simd_f32s(bias);
    let (out, out_tail) = S::as_mut_simd_f32s(out);
    for (((out, &x), &w), &b) in out.iter_mut().zip(x).zip(w).zip(b) {
        *out = simd.mul_add_f32s(simd.mul_f32s(simd.sub_f32s(x, mean_lanes), scale_lanes), w, b);
    }
    for (((out, x), w), b) in out_tail.iter_mut().zip(x_tail).zip(w_tail).zip(b_tail) {
        *out = (x - mean) * scale * w + b;
    }
}

/// Mean and `1 / sqrt(var + eps)` of a row.
#[inline(always)]
fn moments<S: Simd>(simd: S, row: &[f32], eps: f32) -> (f32, f32) {
    let (head, tail) = S::as_simd_f32s(row);
    let count = row.len() as f32;
    let sum = head.iter().fold(simd.splat_f32s(0.0), |sum, &v| simd.add_f32s(sum, v));
    let mean = (simd.reduce_sum_f32s(sum) + tail.iter().sum::<f32>()) / count;
    let lanes = simd.splat_f32s(mean);
    let squares = head.iter().fold(simd.splat_f32s(0.0), |sum, &v| {
        let d = simd.sub_f32s(v, lanes);
        simd.mul_add_f32s(d, d, sum)
    });
    let squares = simd.reduce_sum_f32s(squares) + tail.iter().map(|v| (v - mean) * (v - mean)).sum::<f32>();
    (mean, 1.0 / (squares / count + eps).sqrt())
}

struct LayerNorm {
    width: usize,
    eps: f32,
}

struct Forward<'a> {
    x: &'a [f32],
    parameters: [&'a [f32]; 2],
    eps: f32,
    out: &'a mut [f32],
}

impl WithSimd for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let width = self.parameters[0].len();
        for (out, row) in self.out.chunks_exact_mut(width).zip(self.x.chunks_exact(width)) {
            into(simd, row, self.parameters, self.eps, out);
        }
    }
}

/// What one piece of rows adds to the gradients by weight and bias.
struct Backward<'a> {
    x: &'a [f32],
    weight: &'a [f32],
    v_out: &'a [f32],
    eps: f32,
    v_x: &'a mut [f32],
}

impl WithSimd for Backward<'_> {
    /// Gradients by weight and bias, `[C]` each.
    type Output = [Vec<f64>; 2];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let width = self.weight.len();
        let (mut v_weight, mut v_bias) = (vec![0.0_f64; width], vec![0.0_f64; width]);
        let rows = self.x.chunks_exact(width).zip(self.v_out.chunks_exact(width));
        for (v_x, (x, v_out)) in self.v_x.chunks_exact_mut(width).zip(rows) {
            let (mean, scale) = moments(simd, x, self.eps);
            let (mut of_one, mut of_x) = (0.0_f64, 0.0_f64);
            for c in 0..width {
                let standard = (x[c] - mean) * scale;
                v_weight[c] += f64::from(v_out[c] * standard);
                v_bias[c] += f64::from(v_out[c]);
                of_one += f64::from(v_out[c] * self.weight[c]);
                of_x += f64::from(v_out[c] * self.weight[c] * standard);
            }
            let (of_one, of_x) = (single(of_one / width as f64), single(of_x / width as f64));
            for c in 0..width {
                let standard = (x[c] - mean) * scale;
                v_x[c] = scale * (v_out[c] * self.weight[c] - of_one - standard * of_x);
            }
        }
        [v_weight, v_bias]
    }
}

impl CustomOp3 for LayerNorm {
    fn name(&self) -> &'static str {
        "layer-norm"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        weight: &CpuStorage,
        weight_layout: &Layout,
        bias: &CpuStorage,
        bias_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let Self { width, eps } = *self;
        let x = slice(x, x_layout)?;
        let parameters = [slice(weight, weight_layout)?, slice(bias, bias_layout)?];
        let mut out = vec![0.0_f32; x.len()];
        let arch = pulp::Arch::new();
        parallel::for_chunks(&mut out, PIECE * width, &|piece, out| {
            let x = &x[piece * PIECE * width..][..out.len()];
            arch.dispatch(Forward { x, parameters, eps, out });
        });
        Ok((CpuStorage::F32(out), Shape::from((x.len() / width, width))))
    }

    fn bwd(
        &self,
        x: &Tensor,
        weight: &Tensor,
        bias: &Tensor,
        _result: &Tensor,
        v_out: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let Self { width, eps } = *self;
        let (v_x, sums) = with_values([x, weight, v_out], |[x, weight, v_out]| {
            let mut v_x = vec![0.0_f32; x.len()];
            let arch = pulp::Arch::new();
            let rows = x.par_chunks(PIECE * width).zip(v_out.par_chunks(PIECE * width));
            let pieces: Vec<[Vec<f64>; 2]> = v_x
                .par_chunks_mut(PIECE * width)
                .zip(rows)
                .map(|(v_x, (x, v_out))| arch.dispatch(Backward { x, weight, v_out, eps, v_x }))
                .collect();
            let mut sums = [vec![0.0_f64; width], vec![0.0_f64; width]];
            for (sum, piece) in pieces.iter().flat_map(|piece| [0, 1].map(|i| (i, &piece[i]))) {
                sums[sum].iter_mut().zip(piece).for_each(|(sum, v)| *sum += v);
            }
            Ok((v_x, sums.map(|sum| sum.into_iter().map(single).collect::<Vec<f32>>())))
        })?;
        let [v_weight, v_bias] = sums;
        let device = x.device();
        Ok((
            Some(Tensor::from_vec(v_x, x.shape(), device)?),
            Some(Tensor::from_vec(v_weight, weight.shape(), device)?),
            Some(Tensor::from_vec(v_bias, bias.shape(), device)?),
        ))
    }
}
