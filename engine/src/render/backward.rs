//! Back-to-front gradients of the compositing, tile by tile.
//!
//! # Formula
//! With `q = c . v_rgb + z v_depth`, weight `w = alpha T` and `S` the sum of `w q` behind (the background included):
//! `v_alpha = T q - S / (1 - alpha)`. `T` in front of a Gaussian is recovered as `T / (1 - alpha)`, which stays exact enough because
//! a pixel ends before `T` falls to 1e-4. By the exponent `sigma`: `g = -v_sigma = alpha v_alpha`, 0 where alpha was capped.
//! A Gaussian keeps ten sums over its pixels (`Moments`), from which `project_backward` takes everything else.

use pulp::{Simd, WithSimd};

use super::constants::{EXPECTED_DEPTH_EPS, TILE_HEIGHT, TILE_PIXELS, TILE_WIDTH};
use super::forward::TRANSMITTANCE;
use super::lanes::Broadcast;
use super::open::{Open, next};
use super::pixels::{BLOCK, Pixels, fetch};
use super::project::Footprint;
use super::spans::Spans;
use super::tiles::{TileLists, parts};
use super::{ImageGradient, MAPS, Rendered, RenderedWithState};
use crate::parallel;

/// Sums over pixels: `g`, `g dy`, `g dy^2`, `g u`, `g u dy`, `g u^2`, and `w` times the gradients of red, green, blue, depth.
pub(super) const MOMENTS: usize = 10;
/// Sums of one Gaussian over the pixels of one tile.
pub(super) type Moments = [f32; MOMENTS];

/// Gradients of the four drawn channels, then the sum behind, then the transmittance.
const STATE_PLANES: usize = 6;

/// Moments of every intersection, in the order of `lists.intersections`, and the sums of M maps `[H, W]` under its blending weights.
pub(super) fn moments<const M: usize>(
    state: &RenderedWithState,
    gradient: &ImageGradient,
    maps: [&[f32]; M],
) -> (Vec<Moments>, Vec<[f32; M]>) {
    const { assert!(M <= MAPS, "the planes of a tile hold that many maps") };
    let lists = &state.lists;
    let mut all = vec![[0.0_f32; MOMENTS]; lists.intersections.len()];
    let mut sums = vec![[0.0_f32; M]; lists.intersections.len()];
    let arch = pulp::Arch::new();
    let firsts = &lists.first_of_tile;
    parallel::for_each_pair(&mut by_tile(&mut all, firsts), &mut by_tile(&mut sums, firsts), 1, &|tile, out, sums| {
        if out.is_empty() {
            return;
        }
        let mut room = [0.0_f32; (STATE_PLANES + MAPS) * TILE_PIXELS];
        let (planes, map_planes) = room[..(STATE_PLANES + M) * TILE_PIXELS].split_at_mut(STATE_PLANES * TILE_PIXELS);
        let origin = lists.grid.origin(tile);
        load_state(planes, state.planes_of(tile), origin, &state.images, gradient, state.background);
        load_maps(map_planes, &maps, [state.images.width, state.images.height], origin);
        let stops = state.stops_of(tile);
        arch.dispatch(TileMoments { lists, tile, stops, state: planes, maps: map_planes, out, sums });
    });
    (all, sums)
}

/// The part of `all` that belongs to each tile.
pub(super) fn by_tile<'a, T>(all: &'a mut [T], first_of_tile: &[u32]) -> Vec<&'a mut [T]> {
    parts(all, first_of_tile.windows(2).map(|pair| (pair[1] - pair[0]) as usize))
}

/// Fills planes with the part of each map `[H, W]` that the tile covers.
pub(super) fn load_maps(planes: &mut [f32], maps: &[&[f32]], [width, height]: [usize; 2], origin: [usize; 2]) {
    for (map, plane) in maps.iter().zip(planes.chunks_exact_mut(TILE_PIXELS)) {
        for y in 0..TILE_HEIGHT.min(height - origin[1]) {
            let from = (origin[1] + y) * width + origin[0];
            let len = TILE_WIDTH.min(width - origin[0]);
            plane[y * TILE_WIDTH..][..len].copy_from_slice(&map[from..from + len]);
        }
    }
}

/// Fills the tile's planes with the pixel gradients, the sum behind the last Gaussian and the final transmittance.
fn load_state(
    state: &mut [f32],
    planes: &[f32],
    origin: [usize; 2],
    images: &Rendered,
    gradient: &ImageGradient,
    background: [f32; 3],
) {
    let (width, height) = (images.width, images.height);
    for y in 0..TILE_HEIGHT.min(height - origin[1]) {
        for x in 0..TILE_WIDTH.min(width - origin[0]) {
            let (pixel, local) = ((origin[1] + y) * width + origin[0] + x, y * TILE_WIDTH + x);
            let at = |image: &[f32], i: usize| image.get(i).copied().unwrap_or(0.0);
            let v_rgb: [f32; 3] = std::array::from_fn(|c| at(&gradient.rgb, pixel * 3 + c));
            let (mut v_alpha, mut v_depth) = (at(&gradient.alpha, pixel), at(&gradient.depth, pixel));
            let v_expected = at(&gradient.expected_depth, pixel);
            if v_expected != 0.0 {
                let alpha = images.alpha[pixel];
                v_depth += v_expected / alpha.max(EXPECTED_DEPTH_EPS);
                if alpha > EXPECTED_DEPTH_EPS {
                    v_alpha -= v_expected * (images.depth[pixel] / alpha / alpha);
                }
            }
            let t = planes[TRANSMITTANCE * TILE_PIXELS + local].abs();
            let v_background: f32 = (0..3).map(|c| background[c] * v_rgb[c]).sum();
            let values = [v_rgb[0], v_rgb[1], v_rgb[2], v_depth, t * (v_background - v_alpha), t];
            for (plane, value) in values.into_iter().enumerate() {
                state[plane * TILE_PIXELS + local] = value;
            }
        }
    }
}

struct TileMoments<'a, const M: usize> {
    lists: &'a TileLists,
    tile: usize,
    stops: &'a [f32],
    state: &'a [f32],
    maps: &'a [f32],
    out: &'a mut [Moments],
    sums: &'a mut [[f32; M]],
}

impl<const M: usize> WithSimd for TileMoments<'_, M> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { lists, tile: number, stops, state, maps, out, sums } = self;
        let origin = lists.grid.origin(number);
        let (broadcast, last) = (Broadcast::new(simd), last_position(simd, S::as_simd_f32s(stops).0));
        let (mut pixels, mut room) = (Pixels::<{ STATE_PLANES + 1 }>::new(), [Footprint::default(); BLOCK]);
        let plane = |k: usize| if k < STATE_PLANES { &state[k * TILE_PIXELS..(k + 1) * TILE_PIXELS] } else { stops };
        let pixels = pixels.filled::<S>(std::array::from_fn(plane));
        let maps = S::as_simd_f32s(maps).0;
        let mut tile = OpenTile { pixels, maps, origin, open: Open::all(), spans: Spans::new() };
        for (block, intersections) in lists.intersections_of(number).chunks(BLOCK).enumerate().rev() {
            let first = block * BLOCK;
            if first as f32 >= last {
                continue;
            }
            tile.open = Open::before(simd, |i| tile.pixels[i][STATE_PLANES], first);
            for (k, footprint) in fetch(&lists.footprints, intersections, &mut room).iter().enumerate().rev() {
                let position = first + k;
                if (position as f32) < last {
                    (out[position], sums[position]) = unblend(simd, &broadcast, &mut tile, footprint, position as f32);
                }
            }
        }
    }
}

/// A tile: what is known of its pixels so far, with the list position that ended each, and the maps.
struct OpenTile<'a, V> {
    /// The planes of the state, then the list position that ended each pixel.
    pixels: &'a mut [[V; STATE_PLANES + 1]],
    /// `[M, TILE_PIXELS]`.
    maps: &'a [V],
    /// Pixel (x, y) of the upper left corner.
    origin: [usize; 2],
    open: Open,
    spans: Spans,
}

/// The position at which the last pixel of the tile ended; infinity when one did not.
#[inline(always)]
pub(super) fn last_position<S: Simd>(simd: S, stops: &[S::f32s]) -> f32 {
    let largest = stops.iter().fold(simd.splat_f32s(0.0), |m, &s| simd.max_f32s(m, s));
    simd.reduce_max_f32s(largest)
}

/// The moments of one Gaussian over the tile, and the sums of the maps under its weights; moves the tile's state in front of it.
#[inline(always)]
fn unblend<S: Simd, const M: usize>(
    simd: S,
    broadcast: &Broadcast<S>,
    tile: &mut OpenTile<'_, S::f32s>,
    f: &Footprint,
    position: f32,
) -> (Moments, [f32; M]) {
    let OpenTile { pixels, maps, origin, open, spans } = tile;
    let per_plane = TILE_PIXELS / S::F32_LANES;
    let per_row = TILE_WIDTH / S::F32_LANES;
    let colour = f.colour.map(|c| simd.splat_f32s(c));
    let depth = simd.splat_f32s(f.depth);
    let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
    let position = simd.splat_f32s(position);
    let (mut sums, mut under) = ([zero; MOMENTS], [zero; M]);
    for row in spans.set(simd, f, *origin) {
        let (span, reached) = spans.row(row, S::F32_LANES);
        let mut vectors = reached & open.of(row);
        let (mut row_g, mut row_gu) = (zero, zero);
        while let Some(vector) = next(&mut vectors) {
            let i = row * per_row + vector;
            let [vr, vg, vb, vd, behind, transmittance, stop] = &mut pixels[i];
            let a = broadcast.alphas(simd, &span, f.curve_u, vector);
            let live = simd.and_m32s(a.drawn, simd.less_than_f32s(position, *stop));
            let alpha = simd.select_f32s(live, a.alpha, zero);
            let recip = simd.div_f32s(one, simd.sub_f32s(one, alpha));
            let t = simd.mul_f32s(*transmittance, recip);
            let w = simd.mul_f32s(alpha, t);
            let (vr, vg, vb, vd) = (*vr, *vg, *vb, *vd);
            let q = simd.mul_add_f32s(colour[0], vr, simd.mul_f32s(colour[1], vg));
            let q = simd.mul_add_f32s(colour[2], vb, simd.mul_add_f32s(depth, vd, q));
            let s = *behind;
            let v_alpha = simd.sub_f32s(simd.mul_f32s(t, q), simd.mul_f32s(s, recip));
            *behind = simd.mul_add_f32s(w, q, s);
            *transmittance = t;
            let capped = simd.greater_than_f32s(a.uncapped, broadcast.alpha_max);
            let g = simd.select_f32s(capped, zero, simd.mul_f32s(alpha, v_alpha));
            let gu = simd.mul_f32s(g, a.u);
            row_g = simd.add_f32s(row_g, g);
            row_gu = simd.add_f32s(row_gu, gu);
            sums[5] = simd.mul_add_f32s(gu, a.u, sums[5]);
            sums[6] = simd.mul_add_f32s(w, vr, sums[6]);
            sums[7] = simd.mul_add_f32s(w, vg, sums[7]);
            sums[8] = simd.mul_add_f32s(w, vb, sums[8]);
            sums[9] = simd.mul_add_f32s(w, vd, sums[9]);
            for (map, sum) in under.iter_mut().enumerate() {
                *sum = simd.mul_add_f32s(w, maps[map * per_plane + i], *sum);
            }
        }
        let dy = simd.splat_f32s(span.dy);
        let row_gdy = simd.mul_f32s(row_g, dy);
        sums[0] = simd.add_f32s(sums[0], row_g);
        sums[1] = simd.add_f32s(sums[1], row_gdy);
        sums[2] = simd.mul_add_f32s(row_gdy, dy, sums[2]);
        sums[3] = simd.add_f32s(sums[3], row_gu);
        sums[4] = simd.mul_add_f32s(row_gu, dy, sums[4]);
    }
    // A loop, not `map`: its closure would stand outside the vectorised function.
    let (mut moments, mut maps) = ([0.0; MOMENTS], [0.0; M]);
    for (moment, sum) in moments.iter_mut().chain(&mut maps).zip(sums.into_iter().chain(under)) {
        *moment = simd.reduce_sum_f32s(sum);
    }
    (moments, maps)
}
