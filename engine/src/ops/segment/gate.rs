//! Every row its segment's, changed by the row's own inputs.

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp2, Layout, Result, Shape, Tensor};

use super::{Segments, by_rows, sum_into};
use crate::ops::tensors::{slice, with_values};

/// The row of each row's segment, changed by inputs of its own: what rows share says where they are to go, their inputs say how they differ,
/// and what they share decides how far each follows its own.
///
/// # Shapes
/// `x` `[M, C]`, `inputs` `[N, G]`, both f32; result `[N, C]`.
///
/// # Formula
/// `y_k = x_k + u_k`, `y_{H+k} = x_{H+k} u_k` for k below `H = min(G, C / 2)`, `y_k = x_k` beyond.
///
/// # Gradient
/// By `x`, sums in f64; the inputs are constant.
///
/// # Errors
/// When the number of segments or rows does not fit.
pub(crate) fn gather_gated(x: &Tensor, inputs: &Tensor, segments: &Arc<Segments>) -> Result<Tensor> {
    let ((num_segments, width), (rows, num_inputs)) = (x.dims2()?, inputs.dims2()?);
    let expected = (segments.num_segments(), segments.num_rows());
    if (num_segments, rows) != expected {
        candle_core::bail!("gated gather: expected {expected:?} segments and rows, found {:?}", (num_segments, rows));
    }
    let op = GatedGather { segments: segments.clone(), width, num_inputs };
    x.contiguous()?.apply_op2(&inputs.contiguous()?, op)
}

struct GatedGather {
    segments: Arc<Segments>,
    width: usize,
    num_inputs: usize,
}

impl GatedGather {
    fn used(&self) -> usize {
        self.num_inputs.min(self.width / 2)
    }

    /// The inputs of a row that are used.
    fn inputs_of<'a>(&self, inputs: &'a [f32], row: usize) -> &'a [f32] {
        &inputs[row * self.num_inputs..][..self.used()]
    }
}

impl CustomOp2 for GatedGather {
    fn name(&self) -> &'static str {
        "gated-gather"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        inputs: &CpuStorage,
        inputs_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (x, inputs) = (slice(x, x_layout)?, slice(inputs, inputs_layout)?);
        let (rows, width) = (self.segments.num_rows(), self.width);
        let mut out = vec![0.0_f32; rows * width];
        by_rows(&mut out, width, |row, out| {
            out.copy_from_slice(&x[self.segments.segment_of()[row] as usize * width..][..width]);
            let (added, gated) = out.split_at_mut(self.used());
            for ((added, gated), input) in added.iter_mut().zip(gated).zip(self.inputs_of(inputs, row)) {
                *added += input;
                *gated *= input;
            }
        });
        Ok((CpuStorage::F32(out), Shape::from((rows, width))))
    }

    fn bwd(
        &self,
        x: &Tensor,
        inputs: &Tensor,
        _result: &Tensor,
        v_out: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let v_x = with_values([inputs, v_out], |[inputs, v_out]| {
            let mut v_rows = v_out.to_vec();
            by_rows(&mut v_rows, self.width, |row, v_row| {
                let gated = &mut v_row[self.used()..];
                gated.iter_mut().zip(self.inputs_of(inputs, row)).for_each(|(v, input)| *v *= input);
            });
            let mut v_x = vec![0.0_f32; self.segments.num_segments() * self.width];
            sum_into(&v_rows, &self.segments, self.width, |_| 1.0, &mut v_x);
            Ok(v_x)
        })?;
        Ok((Some(Tensor::from_vec(v_x, x.shape(), x.device())?), None))
    }
}
