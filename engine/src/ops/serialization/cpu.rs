//! Codes by bit tricks, orders by sorting pairs of code and row.

use rayon::prelude::*;

use super::{Curve, Order};
use crate::parallel;

/// Rows that one piece of work takes.
const CHUNK: usize = 1 << 13;

/// `[M]` codes; the coordinates have been checked.
#[expect(clippy::cast_sign_loss, reason = "checked to be non-negative")]
pub(super) fn codes(coords: &[[i32; 4]], curve: Curve, depth: u32) -> Vec<u64> {
    let code = |&[batch, x, y, z]: &[i32; 4]| {
        let (x, y, z) = (x as u32, y as u32, z as u32);
        let along = match curve {
            Curve::Z => interleave([x, y, z]),
            Curve::ZTransposed => interleave([y, x, z]),
            Curve::Hilbert => hilbert([x, y, z], depth),
            Curve::HilbertTransposed => hilbert([y, x, z], depth),
        };
        (batch as u64) << (3 * depth) | along
    };
    let mut codes = vec![0; coords.len()];
    parallel::for_chunks(&mut codes, CHUNK, &|chunk, codes| {
        codes.iter_mut().zip(&coords[chunk * CHUNK..]).for_each(|(to, coord)| *to = code(coord));
    });
    codes
}

pub(super) fn order(codes: &[u64]) -> Order {
    let mut pairs: Vec<(u64, u32)> = codes.iter().copied().zip(0..).collect();
    pairs.par_sort_unstable();
    let rows: Vec<u32> = pairs.iter().map(|pair| pair.1).collect();
    let mut positions = vec![0; rows.len()];
    (0..).zip(&rows).for_each(|(position, &row)| positions[row as usize] = position);
    Order { rows, positions }
}

/// Bits of three 16-bit numbers in turns, the first number's highest.
fn interleave([x, y, z]: [u32; 3]) -> u64 {
    spread(x) << 2 | spread(y) << 1 | spread(z)
}

/// The lower 21 bits, two zeros between any two.
fn spread(value: u32) -> u64 {
    let mut v = u64::from(value) & 0x1f_ffff;
    v = (v | v << 32) & 0x001f_0000_0000_ffff;
    v = (v | v << 16) & 0x001f_0000_ff00_00ff;
    v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
    v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
    (v | v << 2) & 0x1249_2492_4924_9249
}

/// Skilling's transform of the axes to the transposed Hilbert index, then the index itself: a Gray code undone.
fn hilbert(mut axes: [u32; 3], depth: u32) -> u64 {
    for bit in (0..depth).rev() {
        let lower = (1_u32 << bit) - 1;
        for axis in 0..3 {
            if axes[axis] >> bit & 1 == 1 {
                axes[0] ^= lower;
            } else {
                let exchange = (axes[0] ^ axes[axis]) & lower;
                axes[0] ^= exchange;
                axes[axis] ^= exchange;
            }
        }
    }
    let gray = interleave(axes);
    [1, 2, 4, 8, 16, 32].into_iter().fold(gray, |code, shift| code ^ code >> shift)
}
