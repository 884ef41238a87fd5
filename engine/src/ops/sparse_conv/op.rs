//! Sparse convolution as a candle operation.

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp2, DType, Layout, Shape, Tensor};

use super::kernel::{Epilogue, PackedWeights, convolve_into};
use super::map::{KernelMap, Symmetry};
use super::weight_gradient::by_weights;
use crate::ops::tensors::{slice, with_values};

/// The sparse convolution of features by a kernel map.
///
/// # Shapes
/// `features` `[map.num_inputs, cin]` f32; `weight` `[cout, k, k, k, cin]` f32, offsets in x, y, z order; result `[map.num_outputs, cout]`.
///
/// # Gradient
/// By both tensors; the map is constant.
///
/// # Errors
/// When a shape or dtype does not fit the map.
pub fn convolve(features: &Tensor, weight: &Tensor, map: &Arc<KernelMap>) -> candle_core::Result<Tensor> {
    let (rows, cin) = features.dims2()?;
    let (cout, k0, k1, k2, weight_cin) = weight.dims5()?;
    if rows != map.num_inputs() || cin != weight_cin || k0 * k1 * k2 != map.num_offsets() {
        candle_core::bail!(
            "sparse convolution: expected features [{}, {weight_cin}] and {} kernel offsets, found [{rows}, {cin}] and {}",
            map.num_inputs(),
            map.num_offsets(),
            k0 * k1 * k2
        );
    }
    if features.dtype() != DType::F32 || weight.dtype() != DType::F32 {
        candle_core::bail!("sparse convolution: expected f32, found {:?} and {:?}", features.dtype(), weight.dtype());
    }
    features.contiguous()?.apply_op2(&weight.contiguous()?, SparseConvolution { map: map.clone(), cin, cout })
}

struct SparseConvolution {
    map: Arc<KernelMap>,
    cin: usize,
    cout: usize,
}

/// Gradient of a scalar by the features, from its gradient by the output rows.
///
/// # Shapes
/// `v_out` `[map.num_outputs, cout]`, `weight` `[cout, num_offsets, cin]`; result `[map.num_inputs, cin]` in `v_features`.
pub fn by_features(v_out: &[f32], weight: &[f32], map: &KernelMap, cin: usize, v_features: &mut [f32]) {
    let num_offsets = map.num_offsets();
    let cout = weight.len() / (num_offsets * cin).max(1);
    // A map that is its own reverse but for the order of the offsets serves with the weights in that order.
    let mirrored = map.symmetry == Symmetry::Mirrored;
    let packed = PackedWeights::pack(num_offsets, cout, cin, |o, k, c| {
        let o = if mirrored { num_offsets - 1 - o } else { o };
        weight[(k * num_offsets + o) * cin + c]
    });
    if mirrored {
        convolve_into(v_out, &packed, map, &Epilogue::default(), v_features);
    } else {
        convolve_into(v_out, &packed, &map.reversed(), &Epilogue::default(), v_features);
    }
}

impl CustomOp2 for SparseConvolution {
    fn name(&self) -> &'static str {
        "sparse-convolution"
    }

    fn cpu_fwd(
        &self,
        features: &CpuStorage,
        features_layout: &Layout,
        weight: &CpuStorage,
        weight_layout: &Layout,
    ) -> candle_core::Result<(CpuStorage, Shape)> {
        let features = slice(features, features_layout)?;
        let weight = slice(weight, weight_layout)?;
        let packed = PackedWeights::of_checkpoint(weight, self.map.num_offsets(), self.cin, self.cout);
        let mut out = vec![0.0_f32; self.map.num_outputs() * self.cout];
        convolve_into(features, &packed, &self.map, &Epilogue::default(), &mut out);
        Ok((CpuStorage::F32(out), Shape::from((self.map.num_outputs(), self.cout))))
    }

    fn bwd(
        &self,
        features: &Tensor,
        weight: &Tensor,
        _result: &Tensor,
        gradient: &Tensor,
    ) -> candle_core::Result<(Option<Tensor>, Option<Tensor>)> {
        let (v_features, v_weight) = with_values([features, weight, gradient], |[inputs, values, v_out]| {
            let mut v_features = vec![0.0_f32; inputs.len()];
            by_features(v_out, values, &self.map, self.cin, &mut v_features);
            Ok((v_features, by_weights(inputs, v_out, &self.map, self.cin, self.cout)))
        })?;
        Ok((
            Some(Tensor::from_vec(v_features, features.shape(), features.device())?),
            Some(Tensor::from_vec(v_weight, weight.shape(), weight.device())?),
        ))
    }
}
