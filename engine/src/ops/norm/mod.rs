//! Layer and batch normalisation with exact gradients.

mod batch;
mod layer;
pub mod reference;

pub use batch::{BatchStatistics, batch_norm};
pub(crate) use layer::normalise_row;
pub use layer::{RowNorm, layer_norm};

use candle_core::{Result, Tensor};

/// `(N, C)` when the shapes are `[N, C]`, `[C]`, `[C]` with C above 0.
fn checked(what: &str, x: &Tensor, weight: &Tensor, bias: &Tensor) -> Result<(usize, usize)> {
    let (rows, width) = x.dims2()?;
    if width == 0 || weight.dims() != [width] || bias.dims() != [width] {
        let dims = [x, weight, bias].map(Tensor::dims);
        candle_core::bail!("{what}: expected [N, C], [C], [C] with C above 0, found {dims:?}");
    }
    Ok((rows, width))
}

#[expect(clippy::cast_possible_truncation, reason = "gradients and statistics are stored in f32")]
fn single(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests;
