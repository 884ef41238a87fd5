//! Which vectors of a tile's pixels still take part.

use pulp::Simd;

use super::constants::{TILE_HEIGHT, TILE_WIDTH};

/// The vectors of pixels that still take part: a bit for each of a row.
#[derive(Clone, Copy, Debug)]
pub(super) struct Open([u32; TILE_HEIGHT]);

impl Open {
    pub(super) const fn all() -> Self {
        Self([u32::MAX; TILE_HEIGHT])
    }

    /// Those of which a pixel has not ended at a position in the list of the tile, by the positions at which pixels did.
    #[inline(always)]
    pub(super) fn before<S: Simd>(simd: S, stops: impl Fn(usize) -> S::f32s, position: usize) -> Self {
        let (per_row, position) = (TILE_WIDTH / S::F32_LANES, simd.splat_f32s(position as f32));
        let mut open = Self([0; TILE_HEIGHT]);
        for (row, bits) in open.0.iter_mut().enumerate() {
            for vector in 0..per_row {
                let going_on = simd.less_than_f32s(position, stops(row * per_row + vector));
                *bits |= u32::from(is_any(simd, going_on)) << vector;
            }
        }
        open
    }

    /// Those of a row.
    #[inline(always)]
    pub(super) fn of(&self, row: usize) -> u32 {
        self.0[row]
    }

    #[inline(always)]
    pub(super) fn close(&mut self, row: usize, vector: usize) {
        self.0[row] &= !(1 << vector);
    }

    #[inline(always)]
    pub(super) fn is_empty(&self, per_row: usize) -> bool {
        let bits = u32::MAX >> (32 - per_row);
        self.0.iter().fold(0, |any, row| any | row) & bits == 0
    }
}

/// Whether a lane is set.
#[inline(always)]
pub(super) fn is_any<S: Simd>(simd: S, mask: S::m32s) -> bool {
    simd.first_true_m32s(mask) != S::F32_LANES
}

/// Takes the lowest of the vectors that are left.
#[inline(always)]
pub(super) fn next(vectors: &mut u32) -> Option<usize> {
    let lowest = vectors.trailing_zeros();
    (*vectors != 0).then(|| {
        *vectors &= *vectors - 1;
        lowest as usize
    })
}

#[cfg(test)]
mod tests {
    use pulp::{Arch, WithSimd};

    use super::*;
    use crate::render::constants::TILE_PIXELS;

    /// Positions at which pixels end, and one in the list of a tile.
    struct Left<'a>(&'a [f32; TILE_PIXELS], usize);

    impl WithSimd for Left<'_> {
        type Output = (Open, usize);

        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            let stops = S::as_simd_f32s(self.0).0;
            (Open::before(simd, |i| stops[i], self.1), S::F32_LANES)
        }
    }

    #[test]
    fn vectors_are_open_until_their_last_pixel_has_ended() {
        let stops: [f32; TILE_PIXELS] = std::array::from_fn(|pixel| if pixel % 7 == 3 { f32::INFINITY } else { 20.0 });
        let of = |stops: &[f32; TILE_PIXELS], position| Arch::new().dispatch(Left(stops, position));
        let (early, lanes) = of(&stops, 19);
        let per_row = TILE_WIDTH / lanes;
        assert!((0..TILE_HEIGHT).all(|row| early.of(row).count_ones() as usize == per_row));
        let (late, _) = of(&stops, 20);
        for vector in 0..TILE_PIXELS / lanes {
            let has_open = (vector * lanes..(vector + 1) * lanes).any(|pixel| pixel % 7 == 3);
            assert_eq!(late.of(vector / per_row) >> (vector % per_row) & 1 == 1, has_open, "vector {vector}");
        }
        let (mut all, _) = of(&[20.0; TILE_PIXELS], 19);
        assert!(!all.is_empty(per_row) && of(&[20.0; TILE_PIXELS], 20).0.is_empty(per_row));
        for row in 0..TILE_HEIGHT {
            for vector in 0..per_row {
                assert!(!all.is_empty(per_row));
                all.close(row, vector);
            }
        }
        assert!(all.is_empty(per_row));
        let mut vectors = 0b1010;
        assert_eq!([next(&mut vectors), next(&mut vectors), next(&mut vectors)], [Some(1), Some(3), None]);
    }
}
