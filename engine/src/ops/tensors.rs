//! Values of candle tensors as slices, and rows as tensors.

use candle_core::{CpuStorage, Layout, Result, Storage, Tensor};

use super::DEVICE;

/// Rows of `width` values as a tensor `[N, width]`.
///
/// # Errors
/// When they are no whole rows.
pub fn of_rows(values: Vec<f32>, width: usize) -> Result<Tensor> {
    let rows = values.len() / width.max(1);
    Tensor::from_vec(values, (rows, width), &DEVICE)
}

/// The values of a contiguous tensor that an operation was given.
pub(crate) fn slice<'a>(storage: &'a CpuStorage, layout: &Layout) -> Result<&'a [f32]> {
    match layout.contiguous_offsets() {
        Some((start, end)) => Ok(&storage.as_slice::<f32>()?[start..end]),
        None => candle_core::bail!("expected contiguous values, found strides {:?}", layout.stride()),
    }
}

/// As [`slice`], to change them.
pub(crate) fn slice_mut<'a>(storage: &'a mut CpuStorage, layout: &Layout) -> Result<&'a mut [f32]> {
    match (layout.contiguous_offsets(), storage) {
        (Some((start, end)), CpuStorage::F32(values)) => Ok(&mut values[start..end]),
        _ => candle_core::bail!("expected contiguous f32 values, found strides {:?}", layout.stride()),
    }
}

/// What `read` makes of the values of f32 tensors on the host, without a copy of those that are contiguous.
///
/// # Errors
/// Those of `read`, and tensors of other types or places.
pub fn with_values<const N: usize, T>(tensors: [&Tensor; N], read: impl FnOnce([&[f32]; N]) -> Result<T>) -> Result<T> {
    let tensors = tensors.into_iter().map(Tensor::contiguous).collect::<Result<Vec<Tensor>>>()?;
    let guards: Vec<_> = tensors.iter().map(Tensor::storage_and_layout).collect();
    let mut slices = [&[] as &[f32]; N];
    for (values, (storage, layout)) in slices.iter_mut().zip(&guards) {
        let Storage::Cpu(storage) = &**storage else { candle_core::bail!("expected a tensor on the host") };
        *values = slice(storage, layout)?;
    }
    read(slices)
}
