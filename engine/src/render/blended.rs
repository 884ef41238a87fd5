//! Maps summed under the blending weights of every Gaussian.

use pulp::{Simd, WithSimd};

use super::RenderedWithState;
use super::backward::{by_tile, last_position, load_maps};
use super::constants::{TILE_PIXELS, TILE_WIDTH};
use super::lanes::Broadcast;
use super::open::{Open, next};
use super::pixels::{BLOCK, Pixels, fetch};
use super::project::Footprint;
use super::spans::Spans;
use super::tiles::TileLists;
use crate::parallel;

/// Most maps that one pass over the tiles takes.
pub const MAPS: usize = 6;

/// Sums of up to M of [`MAPS`] maps under the weights with which each visible Gaussian was blended.
///
/// # Shapes
/// `maps` of `[H, W]`; result `[num_visible, M]`, in the order of [`RenderedWithState::visible`], 0 beyond the maps.
///
/// # Formula
/// `sum_p w_i(p) m(p)`, `w_i = alpha_i T_i` as [`render`](super::render) blends: per tile in f32, over the tiles in f64.
pub fn blended_sums<const M: usize>(state: &RenderedWithState, maps: &[&[f32]]) -> Vec<[f64; M]> {
    const { assert!(M <= MAPS, "the planes of a tile hold that many maps") };
    over_tiles(&state.lists, &entry_sums::<M>(state, maps))
}

/// Sums over the tiles of each visible Gaussian.
pub(super) fn over_tiles<const M: usize>(lists: &TileLists, by_intersection: &[[f32; M]]) -> Vec<[f64; M]> {
    let of_visible = |visible: usize| {
        let places_of_splats =
            &lists.places_of_splats[lists.first_of_splat[visible] as usize..lists.first_of_splat[visible + 1] as usize];
        let mut sums = [0.0; M];
        for &place_of_splat in places_of_splats {
            sums.iter_mut()
                .zip(&by_intersection[place_of_splat as usize])
                .for_each(|(sum, &part)| *sum += f64::from(part));
        }
        sums
    };
    parallel::map(lists.footprints.len(), 1024, &of_visible)
}

/// Sums of every intersection of a Gaussian and a tile, in the order of the lists.
fn entry_sums<const M: usize>(state: &RenderedWithState, maps: &[&[f32]]) -> Vec<[f32; M]> {
    let lists = &state.lists;
    let mut all = vec![[0.0_f32; M]; lists.intersections.len()];
    let arch = pulp::Arch::new();
    parallel::for_each(&mut by_tile(&mut all, &lists.first_of_tile), 1, &|tile, out| {
        if out.is_empty() {
            return;
        }
        let mut planes = [0.0_f32; MAPS * TILE_PIXELS];
        let planes = &mut planes[..M * TILE_PIXELS];
        load_maps(planes, maps, [state.images.width, state.images.height], lists.grid.origin(tile));
        let stops = state.stops_of(tile);
        arch.dispatch(TileSums { lists, tile, stops, maps: planes, out });
    });
    all
}

struct TileSums<'a, const M: usize> {
    lists: &'a TileLists,
    tile: usize,
    /// List position that ended each pixel.
    stops: &'a [f32],
    /// `[M, TILE_PIXELS]`.
    maps: &'a [f32],
    out: &'a mut [[f32; M]],
}

impl<const M: usize> WithSimd for TileSums<'_, M> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { lists, tile: number, stops, maps, out } = self;
        let origin = lists.grid.origin(number);
        let last = last_position(simd, S::as_simd_f32s(stops).0);
        let (mut pixels, mut room) = (Pixels::<2>::new(), [Footprint::default(); BLOCK]);
        let pixels = pixels.filled::<S>([stops, &[1.0; TILE_PIXELS]]);
        let (broadcast, maps) = (Broadcast::new(simd), S::as_simd_f32s(maps).0);
        let mut tile = OpenTile { simd, broadcast, pixels, maps, origin, open: Open::all(), spans: Spans::new() };
        let blocks = lists.intersections_of(number).chunks(BLOCK).zip(out.chunks_mut(BLOCK)).enumerate();
        for (block, (intersections, out)) in blocks {
            let footprints = fetch(&lists.footprints, intersections, &mut room);
            tile.open = Open::before(simd, |i| tile.pixels[i][0], block * BLOCK);
            for (k, (footprint, out)) in footprints.iter().zip(out).enumerate() {
                let position = (block * BLOCK + k) as f32;
                if position >= last {
                    return;
                }
                *out = tile.gather(footprint, position);
            }
        }
    }
}

/// A tile that is walked from the front.
struct OpenTile<'a, S: Simd> {
    simd: S,
    broadcast: Broadcast<S>,
    /// The list position that ended each pixel, and the transmittance.
    pixels: &'a mut [[S::f32s; 2]],
    /// `[M, TILE_PIXELS]`.
    maps: &'a [S::f32s],
    /// Pixel (x, y) of the upper left corner.
    origin: [usize; 2],
    open: Open,
    spans: Spans,
}

impl<S: Simd> OpenTile<'_, S> {
    /// The sums of one Gaussian over the tile; moves the transmittance behind it.
    #[inline(always)]
    fn gather<const M: usize>(&mut self, f: &Footprint, position: f32) -> [f32; M] {
        let Self { simd, ref broadcast, ref mut pixels, maps, origin, ref open, ref mut spans } = *self;
        let per_plane = TILE_PIXELS / S::F32_LANES;
        let per_row = TILE_WIDTH / S::F32_LANES;
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let position = simd.splat_f32s(position);
        let mut sums = [zero; M];
        for row in spans.set(simd, f, origin) {
            let (span, reached) = spans.row(row, S::F32_LANES);
            let mut vectors = reached & open.of(row);
            while let Some(vector) = next(&mut vectors) {
                let i = row * per_row + vector;
                let [stop, transmittance] = &mut pixels[i];
                let a = broadcast.alphas(simd, &span, f.curve_u, vector);
                let live = simd.and_m32s(a.drawn, simd.less_than_f32s(position, *stop));
                let alpha = simd.select_f32s(live, a.alpha, zero);
                let w = simd.mul_f32s(alpha, *transmittance);
                *transmittance = simd.mul_f32s(*transmittance, simd.sub_f32s(one, alpha));
                for (map, sum) in sums.iter_mut().enumerate() {
                    *sum = simd.mul_add_f32s(w, maps[map * per_plane + i], *sum);
                }
            }
        }
        let mut out = [0.0; M];
        for (out, sum) in out.iter_mut().zip(sums) {
            *out = simd.reduce_sum_f32s(sum);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gaussians::physical::Splat;
    use crate::render::{ImageGradient, backward, backward_with_sums, render_for_gradient};
    use crate::views::samples::ahead;

    /// The gradient by a colour is the sum of the image's gradient under the blending weights.
    #[test]
    fn sums_are_those_of_the_colour_gradient() {
        let view = ahead(50, 37, 40.0);
        let at = |i: usize, salt: f32| (i as f32 * 78.233 + salt).sin() * 43_758.547 % 1.0;
        let splat = |i: usize| Splat {
            mean: [2.0 * at(i, 0.1), 1.5 * at(i, 0.7), 3.0 + at(i, 1.3)],
            quat: [1.0, at(i, 2.0), 0.3, 0.0],
            scale: [0.15, 0.3, 0.1],
            opacity: 0.9 * at(i, 5.0).abs(),
            ..Splat::default()
        };
        let splats: Vec<Splat> = (0..200).map(splat).collect();
        let state = render_for_gradient(&splats, &view, [0.0; 3]);
        let maps: Vec<Vec<f32>> = (0..5).map(|m| (0..50 * 37).map(|p| at(p, m as f32)).collect()).collect();
        let refs: Vec<&[f32]> = maps.iter().map(Vec::as_slice).collect();
        let got = blended_sums::<MAPS>(&state, &refs);
        assert_eq!(got.len(), state.visible().count());
        for group in 0..2 {
            let value = |p: usize, k: usize| maps.get(3 * group + k).map_or(0.0, |m| m[p]);
            let rgb = (0..50 * 37).flat_map(|p| [value(p, 0), value(p, 1), value(p, 2)]).collect();
            let gradient = ImageGradient { rgb, ..ImageGradient::default() };
            let want = backward(&splats, &view, &state, &gradient);
            for (i, sums) in state.visible().zip(&got) {
                for (k, sum) in sums[3 * group..3 * group + 3].iter().enumerate() {
                    let want = f64::from(want[i].colour[k]);
                    assert!((sum - want).abs() < 1e-4 * (1.0 + want.abs()), "map {k} Gaussian {i}: {sum} {want}");
                }
            }
            // On the way of the gradient the same sums are found, and the gradient is the same to the bit.
            let maps = [refs[0], refs[3 * group]];
            let (by_splat, sums) = backward_with_sums(&splats, &view, &state, &gradient, maps);
            for (((i, by_splat), sums), got) in state.visible().zip(by_splat).zip(sums).zip(&got) {
                assert_eq!(by_splat, want[i]);
                for (sum, want) in sums.iter().zip([got[0], got[3 * group]]) {
                    assert!((sum - want).abs() < 1e-4 * (1.0 + want.abs()), "Gaussian {i}: {sum} {want}");
                }
            }
        }
    }
}
