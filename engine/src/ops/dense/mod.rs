//! Dense layers: `x W^T + b` and its gradients.
//!
//! The weights are packed into panels, so that the inner loop reads them in a row and keeps its sums in registers. [`linear`] packs them at
//! every call and knows its gradients; a [`Layer`] is packed once.

mod gradient;
mod kernel;
mod layer;
pub mod reference;

use candle_core::{CpuStorage, CustomOp3, Layout, Result, Shape, Tensor};

pub use kernel::Packed;
pub(crate) use kernel::{Product, Rows, Store};
pub use layer::Layer;

use super::tensors::{slice, with_values};
use crate::parallel;

/// Rows that one piece of work takes: its operands stay in the second-level cache.
const BLOCK: usize = 256;

/// A dense layer.
///
/// # Shapes
/// `x` `[N, inputs]`, `weight` `[outputs, inputs]`, `bias` `[outputs]`, all f32; result `[N, outputs]`.
///
/// # Formula
/// `x W^T + b`
///
/// # Gradient
/// By all three, exact; sums over rows in f64.
///
/// # Errors
/// When a shape or dtype does not fit.
pub fn linear(x: &Tensor, weight: &Tensor, bias: &Tensor) -> Result<Tensor> {
    let (outputs, inputs) = checked(weight, bias)?;
    if x.dims2()?.1 != inputs {
        candle_core::bail!("linear: expected [N, {inputs}], found {:?}", x.dims());
    }
    x.contiguous()?.apply_op3(&weight.contiguous()?, &bias.contiguous()?, Linear { inputs, outputs })
}

/// `(outputs, inputs)` of a layer whose weights and biases fit.
///
/// # Errors
/// When they do not, or either number is 0.
fn checked(weight: &Tensor, bias: &Tensor) -> Result<(usize, usize)> {
    let (outputs, inputs) = weight.dims2()?;
    if bias.dims() != [outputs] || inputs == 0 || outputs == 0 {
        candle_core::bail!(
            "linear: expected [o, i], [o] with i and o above 0, found {:?}, {:?}",
            weight.dims(),
            bias.dims()
        );
    }
    Ok((outputs, inputs))
}

/// `x W^T + b` on slices, in parallel.
///
/// # Shapes
/// `x` `[N, packed.depth()]`, `bias` `[packed.columns()]` or empty, `out` `[N, packed.columns()]`; lengths are checked by the callers.
pub fn multiply_into(x: &[f32], packed: &Packed, bias: &[f32], out: &mut [f32]) {
    multiply(x, packed, bias, Store::Replace, out);
}

/// As [`multiply_into`], the product in place of what `out` held or added to it.
fn multiply(x: &[f32], packed: &Packed, bias: &[f32], store: Store, out: &mut [f32]) {
    let (depth, columns) = (packed.depth(), packed.columns());
    if columns == 0 {
        return;
    }
    let arch = pulp::Arch::new();
    parallel::for_chunks(out, BLOCK * columns, &|block, out| {
        let count = out.len() / columns;
        let rows = Rows { values: &x[block * BLOCK * depth..][..count * depth], stride: depth, count };
        arch.dispatch(Product { rows, packed, bias, out, out_stride: columns, store });
    });
}

struct Linear {
    inputs: usize,
    outputs: usize,
}

impl CustomOp3 for Linear {
    fn name(&self) -> &'static str {
        "linear"
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
        let packed = Packed::of_checkpoint(slice(weight, weight_layout)?, self.inputs, self.outputs);
        let rows = x.len() / self.inputs;
        let mut out = vec![0.0_f32; rows * self.outputs];
        multiply_into(x, &packed, slice(bias, bias_layout)?, &mut out);
        Ok((CpuStorage::F32(out), Shape::from((rows, self.outputs))))
    }

    fn bwd(
        &self,
        x: &Tensor,
        weight: &Tensor,
        bias: &Tensor,
        _result: &Tensor,
        v_out: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let Self { inputs, outputs } = *self;
        let (v_x, v_weight, v_bias) = with_values([x, weight, v_out], |[rows, weight, v_out]| {
            let transposed = Packed::new(outputs, inputs, |o, i| weight[o * inputs + i]);
            let mut v_x = vec![0.0_f32; rows.len()];
            multiply_into(v_out, &transposed, &[], &mut v_x);
            let (v_weight, v_bias) = gradient::by_parameters(rows, v_out, inputs, outputs);
            Ok((v_x, v_weight, v_bias))
        })?;
        let device = x.device();
        Ok((
            Some(Tensor::from_vec(v_x, x.shape(), device)?),
            Some(Tensor::from_vec(v_weight, weight.shape(), device)?),
            Some(Tensor::from_vec(v_bias, bias.shape(), device)?),
        ))
    }
}

#[cfg(test)]
mod tests;
