//! Batch normalisation: every column by its own mean and variance.

use std::ops::Range;
use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp3, Layout, Result, Shape, Tensor};

use super::{checked, single};
use crate::ops::tensors::{slice, with_values};
use crate::parallel;

/// Rows of one piece of work: fixed, so that results do not depend on the number of threads.
const PIECE: usize = 1 << 12;

/// Moments of the columns of a batch.
#[derive(Clone, Debug, PartialEq)]
pub struct BatchStatistics {
    /// Number of rows.
    pub count: usize,
    /// `[C]`.
    pub mean: Vec<f64>,
    /// `[C]` mean squared distance to the mean (biased).
    pub variance: Vec<f64>,
}

/// Columns brought to mean 0 and variance 1, then scaled and shifted; and the moments, for running statistics.
///
/// # Shapes
/// `x` `[N, C]`, `weight` and `bias` `[C]`, all f32; result `[N, C]`.
///
/// # Formula
/// `(x - mean) / sqrt(var + eps) * weight + bias`, mean and (biased) variance over each column, in f64.
///
/// # Gradient
/// By all three, exact, through mean and variance; sums over rows in f64.
///
/// # Errors
/// When a shape or dtype does not fit.
pub fn batch_norm(x: &Tensor, weight: &Tensor, bias: &Tensor, eps: f64) -> Result<(Tensor, BatchStatistics)> {
    let (count, width) = checked("batch norm", x, weight, bias)?;
    let x = x.contiguous()?;
    let (mean, variance) = with_values([&x], |[x]| {
        let mut mean = column_sums(x, width, |_, v| v);
        mean.iter_mut().for_each(|sum| *sum /= count.max(1) as f64);
        let mut variance = column_sums(x, width, |c, v| (v - mean[c]).powi(2));
        variance.iter_mut().for_each(|sum| *sum /= count.max(1) as f64);
        Ok((mean, variance))
    })?;
    let scale = variance.iter().map(|v| 1.0 / (v + eps).sqrt()).collect();
    let op = BatchNorm { moments: Arc::new(Moments { mean: mean.clone(), scale }) };
    let out = x.apply_op3(&weight.contiguous()?, &bias.contiguous()?, op)?;
    Ok((out, BatchStatistics { count, mean, variance }))
}

struct Moments {
    mean: Vec<f64>,
    /// `1 / sqrt(var + eps)`.
    scale: Vec<f64>,
}

struct BatchNorm {
    moments: Arc<Moments>,
}

/// `[C]` sums of `term(column, value)` over the rows.
fn column_sums(x: &[f32], width: usize, term: impl Fn(usize, f64) -> f64 + Sync) -> Vec<f64> {
    pieced_sums(x.len(), width, &|piece| {
        let mut sums = vec![0.0_f64; width];
        for row in x[piece].chunks_exact(width) {
            for (c, (sum, &v)) in sums.iter_mut().zip(row).enumerate() {
                *sum += term(c, f64::from(v));
            }
        }
        sums
    })
}

/// Sum of what `of_piece` makes of the pieces of `len` values, in their order.
fn pieced_sums(len: usize, width: usize, of_piece: &(dyn Fn(Range<usize>) -> Vec<f64> + Sync)) -> Vec<f64> {
    let size = PIECE * width;
    let of_piece = |i: usize| of_piece(i * size..len.min((i + 1) * size));
    let mut sums = vec![0.0; width];
    for piece in parallel::map(len.div_ceil(size), 1, &of_piece) {
        sums.iter_mut().zip(piece).for_each(|(sum, v)| *sum += v);
    }
    sums
}

impl CustomOp3 for BatchNorm {
    fn name(&self) -> &'static str {
        "batch-norm"
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
        let x = slice(x, x_layout)?;
        let (weight, bias) = (slice(weight, weight_layout)?, slice(bias, bias_layout)?);
        let Moments { mean, scale } = &*self.moments;
        let width = weight.len();
        let factors: Vec<f32> = (0..width).map(|c| single(scale[c] * f64::from(weight[c]))).collect();
        let means: Vec<f32> = mean.iter().copied().map(single).collect();
        let mut out = vec![0.0_f32; x.len()];
        parallel::for_chunks(&mut out, PIECE * width, &|piece, out| {
            let x = &x[piece * PIECE * width..];
            for (out, x) in out.chunks_exact_mut(width).zip(x.chunks_exact(width)) {
                for c in 0..width {
                    out[c] = (x[c] - means[c]) * factors[c] + bias[c];
                }
            }
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
        let Moments { mean, scale } = &*self.moments;
        let (v_x, v_weight, v_bias) = with_values([x, weight, v_out], |[x, weight, v_out]| {
            let width = weight.len();
            let rows = (x.len() / width).max(1) as f64;
            let v_bias = column_sums(v_out, width, |_, v| v);
            let v_weight = pieced_sums(x.len(), width, &|piece| {
                let (x, v_out) = (&x[piece.clone()], &v_out[piece]);
                let mut sums = vec![0.0_f64; width];
                for (x, v_out) in x.chunks_exact(width).zip(v_out.chunks_exact(width)) {
                    for c in 0..width {
                        sums[c] += f64::from(v_out[c]) * (f64::from(x[c]) - mean[c]) * scale[c];
                    }
                }
                sums
            });
            let mut v_x = vec![0.0_f32; x.len()];
            parallel::for_chunks(&mut v_x, PIECE * width, &|piece, v_x| {
                let first = piece * PIECE * width;
                let (x, v_out) = (&x[first..], &v_out[first..]);
                let rows_of = x.chunks_exact(width).zip(v_out.chunks_exact(width));
                for (v_x, (x, v_out)) in v_x.chunks_exact_mut(width).zip(rows_of) {
                    for c in 0..width {
                        let standard = (f64::from(x[c]) - mean[c]) * scale[c];
                        let centred = f64::from(v_out[c]) - (v_bias[c] + standard * v_weight[c]) / rows;
                        v_x[c] = single(scale[c] * f64::from(weight[c]) * centred);
                    }
                }
            });
            let stored = |sums: Vec<f64>| sums.into_iter().map(single).collect::<Vec<f32>>();
            Ok((v_x, stored(v_weight), stored(v_bias)))
        })?;
        let device = x.device();
        Ok((
            Some(Tensor::from_vec(v_x, x.shape(), device)?),
            Some(Tensor::from_vec(v_weight, weight.shape(), device)?),
            Some(Tensor::from_vec(v_bias, bias.shape(), device)?),
        ))
    }
}
