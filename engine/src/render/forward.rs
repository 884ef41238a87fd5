//! Front-to-back compositing, tile by tile.

use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::Rendered;
use super::constants::{TILE_HEIGHT, TILE_PIXELS, TILE_WIDTH};
use super::lanes::Broadcast;
use super::open::{Open, is_any, next};
use super::pixels::{BLOCK, Pixels, fetch, write};
use super::project::Footprint;
use super::spans::Spans;
use super::tiles::{TileGrid, TileLists};
use crate::parallel;

/// Red, green, blue, depth, transmittance and the list position that ended each pixel.
pub(super) const PLANES: usize = 6;
/// Plane of the transmittance; negative where the pixel ended before its list did.
pub(super) const TRANSMITTANCE: usize = 4;
/// Plane of the list position that ended the pixel; infinity where none did.
pub(super) const STOP: usize = 5;

/// Composited tiles: `[num_tiles, PLANES, TILE_PIXELS]`. A Gaussian that would bring the transmittance to `opaque` or below ends the pixel.
pub(super) fn composite(lists: &TileLists, opaque: f32) -> Vec<f32> {
    let mut tiles = vec![0.0_f32; lists.grid.num_tiles() * PLANES * TILE_PIXELS];
    let arch = pulp::Arch::new();
    parallel::for_chunks(&mut tiles, PLANES * TILE_PIXELS, &|tile, planes| {
        let (intersections, origin) = (lists.intersections_of(tile), lists.grid.origin(tile));
        arch.dispatch(CompositeTile { footprints: &lists.footprints, intersections, origin, planes, opaque });
    });
    tiles
}

/// One tile to composite.
pub(super) struct CompositeTile<'a> {
    pub(super) footprints: &'a [Footprint],
    /// Indices into `footprints`, nearest first.
    pub(super) intersections: &'a [u32],
    /// Pixel (x, y) of the tile's upper left corner.
    pub(super) origin: [usize; 2],
    /// `[PLANES, TILE_PIXELS]` to fill.
    pub(super) planes: &'a mut [f32],
    /// Transmittance at which a pixel ends.
    pub(super) opaque: f32,
}

impl WithSimd for CompositeTile<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { footprints, intersections, origin, planes, opaque } = self;
        let (mut pixels, mut room) = (Pixels::<PLANES>::new(), [Footprint::default(); BLOCK]);
        let pixels = pixels.vectors::<S>();
        for pixel in &mut *pixels {
            pixel[TRANSMITTANCE] = simd.splat_f32s(1.0);
            pixel[STOP] = simd.splat_f32s(f32::INFINITY);
        }
        let mut tile = OpenTile {
            simd,
            broadcast: Broadcast::new(simd),
            pixels,
            origin,
            opaque,
            open: Open::all(),
            spans: Spans::new(),
        };
        for (block, intersections) in intersections.chunks(BLOCK).enumerate() {
            for (k, footprint) in fetch(footprints, intersections, &mut room).iter().enumerate() {
                tile.blend(footprint, (block * BLOCK + k) as f32);
            }
            if tile.open.is_empty(TILE_WIDTH / S::F32_LANES) {
                break;
            }
        }
        write::<S, PLANES>(tile.pixels, planes);
    }
}

/// A tile that Gaussians are blended into, nearest first.
struct OpenTile<'a, S: Simd> {
    simd: S,
    broadcast: Broadcast<S>,
    pixels: &'a mut [[S::f32s; PLANES]],
    /// Pixel (x, y) of the upper left corner.
    origin: [usize; 2],
    /// Transmittance at which a pixel ends.
    opaque: f32,
    open: Open,
    spans: Spans,
}

impl<S: Simd> OpenTile<'_, S> {
    /// Blends one Gaussian.
    #[inline(always)]
    fn blend(&mut self, f: &Footprint, position: f32) {
        let Self { simd, ref broadcast, ref mut pixels, origin, opaque, ref mut open, ref mut spans } = *self;
        let per_row = TILE_WIDTH / S::F32_LANES;
        let colour = f.colour.map(|c| simd.splat_f32s(c));
        let depth = simd.splat_f32s(f.depth);
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let threshold = simd.splat_f32s(opaque);
        let position = simd.splat_f32s(position);
        for row in spans.set(simd, f, origin) {
            let (span, reached) = spans.row(row, S::F32_LANES);
            let mut vectors = reached & open.of(row);
            while let Some(vector) = next(&mut vectors) {
                let [red, green, blue, depths, transmittance, stop] = &mut pixels[row * per_row + vector];
                let t = *transmittance;
                let a = broadcast.alphas(simd, &span, f.curve_u, vector);
                let live = simd.and_m32s(a.drawn, simd.greater_than_f32s(t, zero));
                let next_t = simd.mul_f32s(t, simd.sub_f32s(one, a.alpha));
                let ends = simd.less_than_or_equal_f32s(next_t, threshold);
                let w = simd.select_f32s(simd.and_m32s(live, simd.not_m32s(ends)), simd.mul_f32s(a.alpha, t), zero);
                let ends = simd.and_m32s(live, ends);
                *red = simd.mul_add_f32s(w, colour[0], *red);
                *green = simd.mul_add_f32s(w, colour[1], *green);
                *blue = simd.mul_add_f32s(w, colour[2], *blue);
                *depths = simd.mul_add_f32s(w, depth, *depths);
                let left = simd.select_f32s(live, next_t, t);
                *transmittance = left;
                if is_any(simd, ends) {
                    let left = simd.select_f32s(ends, simd.neg_f32s(t), left);
                    *transmittance = left;
                    *stop = simd.select_f32s(ends, position, *stop);
                    if !is_any(simd, simd.greater_than_f32s(left, zero)) {
                        open.close(row, vector);
                    }
                }
            }
        }
    }
}

/// Copies the tiles into row-major images over the background colour.
pub(super) fn assemble(tiles: &[f32], grid: TileGrid, size: [usize; 2], background: [f32; 3]) -> Rendered {
    let [width, height] = size;
    let mut rgb = vec![0.0_f32; width * height * 3];
    let mut alpha = vec![0.0_f32; width * height];
    let mut depth = vec![0.0_f32; width * height];
    if width > 0 {
        let rows = rgb.par_chunks_mut(width * 3).zip(alpha.par_chunks_mut(width)).zip(depth.par_chunks_mut(width));
        rows.enumerate().for_each(|(y, ((rgb, alpha), depth))| {
            for column in 0..grid.columns {
                let tile = (y / TILE_HEIGHT) * grid.columns + column;
                let planes = &tiles[tile * PLANES * TILE_PIXELS..(tile + 1) * PLANES * TILE_PIXELS];
                let left = column * TILE_WIDTH;
                let from = (y % TILE_HEIGHT) * TILE_WIDTH;
                for k in 0..TILE_WIDTH.min(width - left) {
                    let value = |plane: usize| planes[plane * TILE_PIXELS + from + k];
                    let t = value(TRANSMITTANCE).abs();
                    for c in 0..3 {
                        rgb[(left + k) * 3 + c] = value(c) + t * background[c];
                    }
                    alpha[left + k] = 1.0 - t;
                    depth[left + k] = value(3);
                }
            }
        });
    }
    Rendered { width, height, rgb, alpha, depth }
}
