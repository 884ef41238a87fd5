//! A dense layer whose weights are packed once.

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp1, InplaceOp2, Layout, Result, Shape, Tensor};
use pulp::Simd;

use super::kernel::{Packed, Product, Rows, Store};
use super::{checked, multiply};
use crate::ops::tensors::{slice, slice_mut, with_values};

/// Weights and biases of a dense layer as the kernel reads them; constants.
#[derive(Clone, Debug)]
pub struct Layer {
    pub(crate) weights: Packed,
    pub(crate) bias: Vec<f32>,
}

impl Layer {
    /// Packs `weight` `[outputs, inputs]` and `bias` `[outputs]`.
    ///
    /// # Errors
    /// When a shape or dtype does not fit.
    pub fn new(weight: &Tensor, bias: &Tensor) -> Result<Self> {
        let (outputs, inputs) = checked(weight, bias)?;
        with_values([weight, bias], |[weight, bias]| {
            Ok(Self { weights: Packed::of_checkpoint(weight, inputs, outputs), bias: bias.to_vec() })
        })
    }

    /// As [`super::linear`], to the bit, but without a gradient.
    ///
    /// # Errors
    /// When a shape or dtype does not fit.
    pub fn forward(self: &Arc<Self>, x: &Tensor) -> Result<Tensor> {
        self.check(x)?;
        x.contiguous()?.apply_op1(PackedLinear(self.clone()))
    }

    /// `onto`, which nobody else may hold, plus the layer on `x`, in the memory of `onto`; without a gradient.
    ///
    /// # Errors
    /// When a shape or dtype does not fit.
    pub(crate) fn add_to(self: &Arc<Self>, onto: Tensor, x: &Tensor) -> Result<Tensor> {
        let expected = [self.check(x)?, self.weights.columns()];
        if onto.dims() != expected {
            candle_core::bail!("packed linear: expected a sum {expected:?}, found {:?}", onto.dims());
        }
        let onto = onto.contiguous()?;
        onto.inplace_op2(&x.contiguous()?, &PackedLinear(self.clone()))?;
        Ok(onto)
    }

    /// The number of rows of `x`.
    fn check(&self, x: &Tensor) -> Result<usize> {
        match x.dims2()? {
            (rows, inputs) if inputs == self.weights.depth() => Ok(rows),
            found => candle_core::bail!("packed linear: expected [N, {}], found {found:?}", self.weights.depth()),
        }
    }

    /// The layer on all rows of `x`, on this thread.
    #[inline(always)]
    pub(crate) fn product<S: Simd>(&self, simd: S, x: &[f32], out: &mut [f32], store: Store) {
        let (depth, columns) = (self.weights.depth(), self.weights.columns());
        let rows = Rows { values: x, stride: depth, count: x.len() / depth };
        simd.vectorize(Product { rows, packed: &self.weights, bias: &self.bias, out, out_stride: columns, store });
    }
}

struct PackedLinear(Arc<Layer>);

impl CustomOp1 for PackedLinear {
    fn name(&self) -> &'static str {
        "packed-linear"
    }

    fn cpu_fwd(&self, x: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (x, Layer { weights, bias }) = (slice(x, layout)?, &*self.0);
        let rows = x.len() / weights.depth();
        let mut out = vec![0.0_f32; rows * weights.columns()];
        multiply(x, weights, bias, Store::Replace, &mut out);
        Ok((CpuStorage::F32(out), Shape::from((rows, weights.columns()))))
    }
}

impl InplaceOp2 for PackedLinear {
    fn name(&self) -> &'static str {
        "add-packed-linear"
    }

    fn cpu_fwd(&self, onto: &mut CpuStorage, onto_layout: &Layout, x: &CpuStorage, x_layout: &Layout) -> Result<()> {
        let Layer { weights, bias } = &*self.0;
        multiply(slice(x, x_layout)?, weights, bias, Store::Add, slice_mut(onto, onto_layout)?);
        Ok(())
    }
}
