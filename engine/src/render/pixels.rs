//! What the passes over a tile hold while they walk through its Gaussians: pixels by the vector, footprints by the block.

use pulp::Simd;

use super::constants::TILE_PIXELS;
use super::project::Footprint;

/// Footprints that are fetched together: their places in memory are far apart, and one wait is as long as sixteen.
pub(super) const BLOCK: usize = 16;

/// P planes of a tile `[TILE_PIXELS / lanes, P, lanes]`: those of a vector of pixels lie side by side.
///
/// Planes one behind the other would be a multiple of 2 KiB apart, and a processor takes a load for one of what it has just stored where the
/// last 12 bits of both places agree.
#[derive(Debug)]
#[repr(C, align(64))]
pub(super) struct Pixels<const P: usize>([[f32; TILE_PIXELS]; P]);

impl<const P: usize> Pixels<P> {
    /// Zeros.
    pub(super) const fn new() -> Self {
        Self([[0.0; TILE_PIXELS]; P])
    }

    /// The vectors of pixels.
    #[inline(always)]
    pub(super) fn vectors<S: Simd>(&mut self) -> &mut [[S::f32s; P]] {
        S::as_mut_simd_f32s(self.0.as_flattened_mut()).0.as_chunks_mut::<P>().0
    }

    /// The vectors of pixels, filled with planes `[P, TILE_PIXELS]`.
    #[inline(always)]
    pub(super) fn filled<S: Simd>(&mut self, planes: [&[f32]; P]) -> &mut [[S::f32s; P]] {
        let vectors = self.vectors::<S>();
        for (k, plane) in planes.into_iter().enumerate() {
            vectors.iter_mut().zip(S::as_simd_f32s(plane).0).for_each(|(vector, &values)| vector[k] = values);
        }
        vectors
    }
}

/// Writes vectors of pixels to planes `[P, TILE_PIXELS]`.
#[inline(always)]
pub(super) fn write<S: Simd, const P: usize>(vectors: &[[S::f32s; P]], planes: &mut [f32]) {
    for (k, plane) in planes.chunks_exact_mut(TILE_PIXELS).enumerate() {
        S::as_mut_simd_f32s(plane).0.iter_mut().zip(vectors).for_each(|(values, vector)| *values = vector[k]);
    }
}

/// Copies of the footprints of a block of a tile's list.
#[inline(always)]
pub(super) fn fetch<'a>(footprints: &[Footprint], block: &[u32], room: &'a mut [Footprint; BLOCK]) -> &'a [Footprint] {
    let copies = &mut room[..block.len()];
    copies.iter_mut().zip(block).for_each(|(copy, &intersection)| *copy = footprints[intersection as usize]);
    copies
}
