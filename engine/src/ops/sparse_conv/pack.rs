//! The weights and biases of a convolution in one tensor, in the order in which the kernel reads them.

use candle_core::{CpuStorage, CustomOp2, DType, Layout, Result, Shape, Tensor};

use crate::ops::tensors::{slice, with_values};
use crate::parallel;

/// Output channels of a panel.
pub(super) const PANEL: usize = 32;

/// Sizes of a convolution's weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WeightShape {
    /// Kernel offsets.
    pub num_offsets: usize,
    /// Input channels.
    pub cin: usize,
    /// Output channels.
    pub cout: usize,
}

/// Weights as the kernel reads them: `[num_offsets, panels, cin, PANEL]`, padded with zeros.
#[derive(Clone, Copy, Debug)]
pub struct PackedWeights<'a> {
    pub(super) shape: WeightShape,
    data: &'a [f32],
}

/// Weights and biases as the kernel reads them, differentiable by what they were packed from.
#[derive(Clone, Debug)]
pub struct ConvWeights {
    /// Packed weights, then `[cout]` biases.
    pub(super) values: Tensor,
    pub(super) shape: WeightShape,
}

impl WeightShape {
    pub(super) fn panels(self) -> usize {
        self.cout.div_ceil(PANEL)
    }

    /// Number of packed values.
    pub(super) fn num_packed(self) -> usize {
        self.num_offsets * self.panels() * self.cin * PANEL
    }

    /// Weights of one output channel.
    fn per_output(self) -> usize {
        self.num_offsets * self.cin
    }

    /// The packed values of weights as checkpoints hold them.
    ///
    /// # Shapes
    /// `weight` `[cout, num_offsets, cin]`, offsets in x, y, z order.
    pub fn pack(self, weight: &[f32]) -> Vec<f32> {
        let mut packed = vec![0.0; self.num_packed()];
        self.pack_scaled(weight, |_| 1.0, &mut packed);
        packed
    }

    /// As [`WeightShape::pack`], each output channel times its factor. Padding is not written.
    pub(super) fn pack_scaled(self, weight: &[f32], factor: impl Fn(usize) -> f32 + Sync, packed: &mut [f32]) {
        let Self { num_offsets, cin, cout } = self;
        // Row by row of the checkpoint, so that reading is in order and writing stays within a panel.
        parallel::for_chunks(packed, (cin * PANEL).max(1), &|i, panel| {
            let (offset, first) = (i / self.panels(), i % self.panels() * PANEL);
            for c in first..cout.min(first + PANEL) {
                let (row, factor) = (&weight[(c * num_offsets + offset) * cin..][..cin], factor(c));
                panel[c - first..].iter_mut().step_by(PANEL).zip(row).for_each(|(value, w)| *value = w * factor);
            }
        });
    }

    /// The inverse of [`WeightShape::pack`].
    fn unpack(self, packed: &[f32]) -> Vec<f32> {
        let Self { num_offsets, cin, cout } = self;
        let mut weight = vec![0.0; cout * self.per_output()];
        parallel::for_chunks(&mut weight, cin.max(1), &|i, row| {
            let (c, offset) = (i / num_offsets, i % num_offsets);
            let panel = &packed[(offset * self.panels() + c / PANEL) * cin * PANEL + c % PANEL..];
            row.iter_mut().zip(panel.iter().step_by(PANEL)).for_each(|(to, &value)| *to = value);
        });
        weight
    }
}

impl<'a> PackedWeights<'a> {
    /// The first `shape.num_packed()` of `values`, as [`WeightShape::pack`] orders them.
    ///
    /// # Shapes
    /// `values` is no shorter, which the caller has checked.
    pub fn new(shape: WeightShape, values: &'a [f32]) -> Self {
        Self { shape, data: &values[..shape.num_packed()] }
    }

    #[inline(always)]
    pub(super) fn panel(&self, offset: usize, panel: usize) -> &'a [f32] {
        let size = self.shape.cin * PANEL;
        &self.data[(offset * self.shape.panels() + panel) * size..][..size]
    }

    /// The packed values of the same weights with inputs and outputs exchanged, those of offset `o` taken from `source(o)`.
    pub(super) fn transposed(&self, source: impl Fn(usize) -> usize + Sync) -> (WeightShape, Vec<f32>) {
        let WeightShape { num_offsets, cin, cout } = self.shape;
        let shape = WeightShape { num_offsets, cin: cout, cout: cin };
        let mut packed = vec![0.0; shape.num_packed()];
        parallel::for_chunks(&mut packed, (cout * PANEL).max(1), &|i, panel| {
            let (offset, first) = (source(i / shape.panels()), i % shape.panels() * PANEL);
            for (k, row) in panel.chunks_exact_mut(PANEL).enumerate() {
                let from = self.panel(offset, k / PANEL)[first * PANEL + k % PANEL..].iter().step_by(PANEL);
                row.iter_mut().take(cin - first).zip(from).for_each(|(to, &value)| *to = value);
            }
        });
        (shape, packed)
    }
}

impl ConvWeights {
    /// Weights times the factors of their output channels, and the shifts as biases.
    ///
    /// # Shapes
    /// `weight` `[cout, k, k, k, cin]`, offsets in x, y, z order, `affine` `[2, cout]` (factors, then shifts), both f32.
    ///
    /// # Gradient
    /// By both.
    ///
    /// # Errors
    /// When a shape or dtype does not fit.
    pub fn new(weight: &Tensor, affine: &Tensor) -> Result<Self> {
        let (cout, k0, k1, k2, cin) = weight.dims5()?;
        if affine.dims() != [2, cout] || [weight, affine].iter().any(|t| t.dtype() != DType::F32) {
            candle_core::bail!(
                "convolution weights: expected f32 and an affine [2, {cout}], found {:?}, {:?} {:?}",
                weight.dtype(),
                affine.dtype(),
                affine.dims()
            );
        }
        let shape = WeightShape { num_offsets: k0 * k1 * k2, cin, cout };
        let values = weight.contiguous()?.apply_op2(&affine.contiguous()?, Pack { shape })?;
        Ok(Self { values, shape })
    }

    /// Weights as they are, and biases `[cout]`.
    ///
    /// # Errors
    /// As [`ConvWeights::new`].
    pub fn with_bias(weight: &Tensor, bias: &Tensor) -> Result<Self> {
        Self::new(weight, &Tensor::stack(&[&bias.ones_like()?, bias], 0)?)
    }

    /// Weights as they are, without biases.
    ///
    /// # Errors
    /// As [`ConvWeights::new`].
    pub fn without_bias(weight: &Tensor) -> Result<Self> {
        Self::with_bias(weight, &Tensor::zeros(weight.dim(0)?, weight.dtype(), weight.device())?)
    }

    /// The same as constants.
    pub fn detach(&self) -> Self {
        Self { values: self.values.detach(), shape: self.shape }
    }
}

struct Pack {
    shape: WeightShape,
}

impl CustomOp2 for Pack {
    fn name(&self) -> &'static str {
        "pack-convolution-weights"
    }

    fn cpu_fwd(
        &self,
        weight: &CpuStorage,
        weight_layout: &Layout,
        affine: &CpuStorage,
        affine_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (weight, affine) = (slice(weight, weight_layout)?, slice(affine, affine_layout)?);
        let size = self.shape.num_packed();
        let mut values = vec![0.0_f32; size + self.shape.cout];
        self.shape.pack_scaled(weight, |c| affine[c], &mut values[..size]);
        values[size..].copy_from_slice(&affine[self.shape.cout..]);
        let shape = Shape::from(values.len());
        Ok((CpuStorage::F32(values), shape))
    }

    fn bwd(
        &self,
        weight: &Tensor,
        affine: &Tensor,
        _values: &Tensor,
        v_values: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let (v_weight, v_affine) = with_values([weight, affine, v_values], |[weight, affine, v_values]| {
            let (v_packed, v_shift) = v_values.split_at(self.shape.num_packed());
            let mut v_weight = self.shape.unpack(v_packed);
            let mut v_affine = Vec::with_capacity(affine.len());
            let per_output = self.shape.per_output().max(1);
            let rows = v_weight.chunks_exact_mut(per_output).zip(weight.chunks_exact(per_output));
            for ((v, w), factor) in rows.zip(affine) {
                v_affine.push(single(v.iter().zip(w).map(|(v, w)| f64::from(*v) * f64::from(*w)).sum()));
                v.iter_mut().for_each(|v| *v *= factor);
            }
            v_affine.extend(v_shift);
            Ok((v_weight, v_affine))
        })?;
        let made = |values: Vec<f32>, like: &Tensor| Tensor::from_vec(values, like.shape(), like.device()).map(Some);
        Ok((made(v_weight, weight)?, made(v_affine, affine)?))
    }
}

#[expect(clippy::cast_possible_truncation, reason = "gradients are stored in f32")]
pub(super) fn single(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests {
    use super::{PANEL, PackedWeights, WeightShape};
    use crate::ops::test_support::values;

    #[test]
    fn packing_is_undone_and_transposed() {
        for (num_offsets, cin, cout) in [(1, 1, 1), (8, 5, 33), (27, 40, 7), (1, 64, 64)] {
            let shape = WeightShape { num_offsets, cin, cout };
            let weight = values(num_offsets * cin * cout, 3);
            let packed = shape.pack(&weight);
            assert_eq!(shape.unpack(&packed), weight);
            let (other, transposed) = PackedWeights::new(shape, &packed).transposed(|o| num_offsets - 1 - o);
            let back = other.unpack(&transposed);
            for (o, k, c) in [(0, 0, 0), (num_offsets - 1, cin - 1, cout - 1), (num_offsets / 2, cin / 2, 0)] {
                let want = weight[(c * num_offsets + num_offsets - 1 - o) * cin + k];
                assert_eq!(back[(k * num_offsets + o) * cout + c].to_bits(), want.to_bits(), "{o} {k} {c}");
            }
            let padding = |i: &usize| i / PANEL / cin % shape.panels() * PANEL + i % PANEL >= cout;
            assert!((0..packed.len()).filter(padding).all(|i| packed[i] == 0.0));
        }
    }
}
