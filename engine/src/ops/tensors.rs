//! Values of candle tensors as slices.

use candle_core::{CpuStorage, Layout, Result, Storage, Tensor};

/// The values of a contiguous tensor that an operation was given.
pub(crate) fn slice<'a>(storage: &'a CpuStorage, layout: &Layout) -> Result<&'a [f32]> {
    match layout.contiguous_offsets() {
        Some((start, end)) => Ok(&storage.as_slice::<f32>()?[start..end]),
        None => candle_core::bail!("expected contiguous values, found strides {:?}", layout.stride()),
    }
}

/// What `read` makes of the values of f32 tensors on the host, without a copy of those that are contiguous.
pub(crate) fn with_values<const N: usize, T>(
    tensors: [&Tensor; N],
    read: impl FnOnce([&[f32]; N]) -> Result<T>,
) -> Result<T> {
    let tensors = tensors.into_iter().map(Tensor::contiguous).collect::<Result<Vec<Tensor>>>()?;
    let guards: Vec<_> = tensors.iter().map(Tensor::storage_and_layout).collect();
    let mut slices = [&[] as &[f32]; N];
    for (values, (storage, layout)) in slices.iter_mut().zip(&guards) {
        let Storage::Cpu(storage) = &**storage else { candle_core::bail!("expected a tensor on the host") };
        *values = slice(storage, layout)?;
    }
    read(slices)
}
