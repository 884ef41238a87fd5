//! Orders of voxels along space-filling curves.
//!
//! Host only: codes and orders have no gradient.

mod cpu;
pub mod reference;

use rayon::prelude::*;

use crate::error::Result;

/// Bits of a code that hold something: codes are compared as signed integers elsewhere.
const CODE_BITS: u32 = 63;
/// The largest depth: 16 bits per axis, as in the reference.
pub(crate) const DEPTH_MAX: u32 = 16;

/// A way through the voxels of a cube.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Curve {
    /// Morton order: bits of x, y, z interleaved, x highest.
    Z,
    /// Morton order with x and y exchanged.
    #[serde(rename = "z-trans")]
    ZTransposed,
    /// Hilbert's curve.
    Hilbert,
    /// Hilbert's curve with x and y exchanged.
    #[serde(rename = "hilbert-trans")]
    HilbertTransposed,
}

/// The rows along a curve.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Order {
    /// `[M]` the row that comes at each position.
    pub rows: Vec<u32>,
    /// `[M]` the position of each row.
    pub positions: Vec<u32>,
}

/// The smallest depth, bits per axis, whose cube holds every coordinate.
///
/// # Errors
/// When a coordinate is negative or needs more than `DEPTH_MAX` bits.
pub fn depth_of(coords: &[[i32; 4]]) -> Result<u32> {
    let largest = coords.iter().flat_map(|[_, axes @ ..]| axes).fold(0, |all, &c| all | c);
    let depth = i32::BITS - largest.leading_zeros();
    if depth <= DEPTH_MAX {
        return Ok(depth);
    }
    // Names the row.
    codes(coords, Curve::Z, DEPTH_MAX).map(|_| depth)
}

/// `[M]` codes of voxels along a curve.
///
/// # Shapes
/// `coords` `[M]` of batch, x, y, z.
///
/// # Formula
/// `batch << 3 depth | curve(x, y, z)`.
///
/// # Source
/// Morton, 1966; Skilling, Programming the Hilbert curve, AIP Conference Proceedings 707, 2004; order of the axes, transposition and
/// batch bits as Point Transformer V3 has them.
///
/// # Errors
/// When a coordinate is negative or has more than `depth` bits, the batch index does not fit above them, or `depth` exceeds `DEPTH_MAX`.
pub fn codes(coords: &[[i32; 4]], curve: Curve, depth: u32) -> Result<Vec<u64>> {
    if depth > DEPTH_MAX {
        return Err(candle_core::Error::Msg(format!("depth: expected at most {DEPTH_MAX}, found {depth}")).into());
    }
    let batch_bits = CODE_BITS - 3 * depth;
    let outside = |c: &[i32; 4]| {
        let [batch, axes @ ..] = c.map(i64::from);
        !(0..1_i64 << batch_bits.min(32)).contains(&batch) || axes.iter().any(|a| !(0..1 << depth).contains(a))
    };
    if let Some(row) = coords.par_iter().position_first(outside) {
        let message = format!(
            "voxel coordinates: expected a batch below 2^{batch_bits} and axes from 0 to 2^{depth} - 1, found {:?} in row {row}",
            coords[row]
        );
        return Err(candle_core::Error::Msg(message).into());
    }
    Ok(cpu::codes(coords, curve, depth))
}

/// The order of codes, ties by row.
pub fn order(codes: &[u64]) -> Order {
    cpu::order(codes)
}

#[cfg(test)]
mod tests;
