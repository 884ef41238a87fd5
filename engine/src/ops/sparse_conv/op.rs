//! Sparse convolution as a candle operation.

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp2, DType, Layout, Shape, Storage, Tensor};

use super::kernel::{Epilogue, PackedWeights, convolve_into};
use super::map::KernelMap;
use super::weight_gradient::by_weights;

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

fn contiguous<'a>(storage: &'a CpuStorage, layout: &Layout) -> candle_core::Result<&'a [f32]> {
    match layout.contiguous_offsets() {
        Some((start, end)) => Ok(&storage.as_slice::<f32>()?[start..end]),
        None => candle_core::bail!("sparse convolution: expected contiguous tensors"),
    }
}

/// What `read` makes of the values of a contiguous f32 tensor on the host.
fn with_values<T>(tensor: &Tensor, read: impl FnOnce(&[f32]) -> T) -> candle_core::Result<T> {
    let (storage, layout) = tensor.storage_and_layout();
    match &*storage {
        Storage::Cpu(storage) => Ok(read(contiguous(storage, layout)?)),
        _ => candle_core::bail!("sparse convolution: expected tensors on the host"),
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
        let features = contiguous(features, features_layout)?;
        let weight = contiguous(weight, weight_layout)?;
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
        let gradient = gradient.contiguous()?;
        let packed = with_values(weight, |values| {
            PackedWeights::of_checkpoint_transposed(values, self.map.num_offsets(), self.cin, self.cout)
        })?;
        let mut v_features = vec![0.0_f32; features.elem_count()];
        with_values(&gradient, |v_out| {
            convolve_into(v_out, &packed, &self.map.reversed(), &Epilogue::default(), &mut v_features);
        })?;
        let v_weight = with_values(features, |inputs| {
            with_values(&gradient, |v_out| by_weights(inputs, v_out, &self.map, self.cin, self.cout))
        })??;
        Ok((
            Some(Tensor::from_vec(v_features, features.shape(), features.device())?),
            Some(Tensor::from_vec(v_weight, weight.shape(), weight.device())?),
        ))
    }
}
