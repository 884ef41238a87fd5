//! What every Gaussian does to the loss by itself: exact effects of taking it out, and what its halves could gain.
//!
//! # Formula
//! A pixel's colour is affine in the alpha of each Gaussian on its ray. With `B_i` what stands behind Gaussian i, composited by itself
//! (`B_{i-1} = alpha_i c_i + (1 - alpha_i) B_i`, the background behind the last), without i the pixel changes by exactly
//! `T_i alpha_i (B_i - c_i)`; so do the accumulated depth and alpha, of which the expected depth is the ratio. `T_i` in front is recovered as
//! `T / (1 - alpha_i)`.
//!
//! This holds where compositing goes on behind what is opaque: see [`Projection::render_through`](super::Projection::render_through).

use pulp::{Simd, WithSimd};

use super::backward::{by_tile, last_position, load_maps};
use super::blended::over_tiles;
use super::constants::{ALPHA_MIN, EXPECTED_DEPTH_EPS, TILE_HEIGHT, TILE_PIXELS, TILE_WIDTH};
use super::forward::TRANSMITTANCE;
use super::lanes::Broadcast;
use super::open::{Open, next};
use super::pixels::{BLOCK, Pixels, fetch};
use super::project::Footprint;
use super::spans::Spans;
use super::tiles::TileLists;
use super::{Rendered, RenderedWithState};
use crate::ops::lanes::exp2;
use crate::parallel;

/// What a pixel costs, as far as effects are concerned.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PixelCosts {
    /// `[H, W, 3]` rendered colours minus the true ones; zero where the pixel takes no part.
    pub residual: Vec<f32>,
    /// `[H, W]` 1 where a pixel takes part, 0 where it does not.
    pub counted: Vec<f32>,
    /// What an absolute error of 1 in one channel of one pixel costs.
    pub per_colour: f32,
    /// What a squared error of 1 in one channel of one pixel costs beside it.
    pub per_square: f32,
    /// `[H, W, 3]` gradient by the colours of the terms that count as linear.
    pub slopes: Vec<f32>,
    /// `[H, W]` true depth, metres; 0 where it is not known or takes no part.
    pub depth: Vec<f32>,
    /// What an absolute error of 1 m of the expected depth of one pixel costs.
    pub per_depth: f32,
    /// What all pixels cost together.
    pub loss: f64,
}

/// Sums over the pixels of a view for one Gaussian; w its blending weight, s the share of it that is the first half's, r the residual.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Effect {
    /// By how much the costs change without it.
    pub removal: f64,
    /// `sum s w r` by channel.
    pub half: [f64; 3],
    /// `sum w r` by channel.
    pub whole: [f64; 3],
    /// `sum (s w)^2`, `sum s w^2` and `sum w^2`.
    pub squares: [f64; 3],
    /// `sum w`: the pixels that it shows.
    pub shown: f64,
    /// `sum alpha`: the pixels that it would show if nothing stood in front of it.
    pub covered: f64,
}

impl Effect {
    /// Adds another view's.
    pub fn add(&mut self, other: &Self) {
        self.removal += other.removal;
        let sums = |to: &mut [f64; 3], from: &[f64; 3]| to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
        sums(&mut self.half, &other.half);
        sums(&mut self.whole, &other.whole);
        sums(&mut self.squares, &other.squares);
        self.shown += other.shown;
        self.covered += other.covered;
    }
}

/// Sums of one intersection: removal, shown, covered; then half, whole and squares.
const SUMS: usize = 12;
/// Those that know nothing of halves.
const WITHOUT_HALVES: usize = 3;
/// Planes of a tile: residual 3, slopes 3, counted, depth; then drawn depth and alpha; then what is behind: colour 3, depth, alpha; then the
/// transmittance.
const PLANES: usize = 16;

/// Logarithm to base 2 of the largest odds that the other half shows a pixel: beyond it the share is zero.
const MOST_ODDS: f32 = 60.0;

/// Effects of every visible Gaussian of a view; `half`, `whole` and `squares` are zero without `halving`.
///
/// # Shapes
/// `halving` `[num_visible]`, in the order of [`RenderedWithState::visible`]: by how much the logarithm to base 2 of the first half's alpha over
/// the second's grows for a pixel to the right, and down; 0 at the Gaussian's centre. Result `[num_visible]`.
///
/// # Formula
/// `removal = sum_p sum_c (per_colour (|r + d_c| - |r|) + per_square ((r + d_c)^2 - r^2)) + slopes . d + per_depth (|e' - depth| - |e - depth|)`,
/// d the change of the colours as the module says, e and e' the expected depths; `s = 1 / (1 + 2^-(halving . (p - centre)))`.
pub fn effects(state: &RenderedWithState, costs: &PixelCosts, halving: Option<&[[f32; 2]]>) -> Vec<Effect> {
    let without =
        |[removal, shown, covered]: [f64; WITHOUT_HALVES]| Effect { removal, shown, covered, ..Effect::default() };
    let Some(halving) = halving else {
        return sums_of(state, costs, &[]).into_iter().map(without).collect();
    };
    let with = |[removal, shown, covered, a, b, c, d, e, f, g, h, i]: [f64; SUMS]| Effect {
        half: [a, b, c],
        whole: [d, e, f],
        squares: [g, h, i],
        ..without([removal, shown, covered])
    };
    sums_of(state, costs, halving).into_iter().map(with).collect()
}

/// `[num_visible]` the first M sums of every visible Gaussian.
fn sums_of<const M: usize>(state: &RenderedWithState, costs: &PixelCosts, halving: &[[f32; 2]]) -> Vec<[f64; M]> {
    let lists = &state.lists;
    let mut all = vec![[0.0_f32; M]; lists.intersections.len()];
    let arch = pulp::Arch::new();
    parallel::for_each(&mut by_tile(&mut all, &lists.first_of_tile), 1, &|tile, out| {
        if out.is_empty() {
            return;
        }
        let mut planes = [0.0_f32; PLANES * TILE_PIXELS];
        load(&mut planes, state, tile, costs);
        let stops = state.stops_of(tile);
        let per = [costs.per_colour, costs.per_square, costs.per_depth];
        arch.dispatch(TileEffects { lists, tile, stops, planes: &planes, per, halving, out });
    });
    over_tiles(lists, &all)
}

/// Fills the planes of a tile for the walk from behind.
fn load(planes: &mut [f32], state: &RenderedWithState, tile: usize, costs: &PixelCosts) {
    let Rendered { width, height, depth, alpha, .. } = &state.images;
    let (size, origin) = ([*width, *height], state.lists.grid.origin(tile));
    for y in 0..TILE_HEIGHT.min(height - origin[1]) {
        for x in 0..TILE_WIDTH.min(width - origin[0]) {
            let (pixel, local) = ((origin[1] + y) * width + origin[0] + x, y * TILE_WIDTH + x);
            for c in 0..3 {
                planes[c * TILE_PIXELS + local] = costs.residual[3 * pixel + c];
                planes[(3 + c) * TILE_PIXELS + local] = costs.slopes[3 * pixel + c];
                planes[(10 + c) * TILE_PIXELS + local] = state.background[c];
            }
        }
    }
    load_maps(&mut planes[6 * TILE_PIXELS..], &[&costs.counted, &costs.depth, depth, alpha], size, origin);
    let drawn = &state.planes_of(tile)[TRANSMITTANCE * TILE_PIXELS..][..TILE_PIXELS];
    planes[15 * TILE_PIXELS..].iter_mut().zip(drawn).for_each(|(t, drawn)| *t = drawn.abs());
}

struct TileEffects<'a, const M: usize> {
    lists: &'a TileLists,
    tile: usize,
    stops: &'a [f32],
    planes: &'a [f32],
    per: [f32; 3],
    halving: &'a [[f32; 2]],
    out: &'a mut [[f32; M]],
}

impl<const M: usize> WithSimd for TileEffects<'_, M> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { lists, tile, stops, planes, per, halving, out } = self;
        let origin = lists.grid.origin(tile);
        let last = last_position(simd, S::as_simd_f32s(stops).0);
        let per = per.map(|cost| simd.splat_f32s(cost));
        let (mut pixels, mut room) = (Pixels::<{ PLANES + 1 }>::new(), [Footprint::default(); BLOCK]);
        let plane = |k: usize| if k < PLANES { &planes[k * TILE_PIXELS..(k + 1) * TILE_PIXELS] } else { stops };
        let pixels = pixels.filled::<S>(std::array::from_fn(plane));
        let (broadcast, spans) = (Broadcast::new(simd), Spans::new());
        let mut open = OpenTile { simd, broadcast, pixels, origin, per, open: Open::all(), spans };
        for (block, intersections) in lists.intersections_of(tile).chunks(BLOCK).enumerate().rev() {
            let first = block * BLOCK;
            if first as f32 >= last {
                continue;
            }
            let footprints = fetch(&lists.footprints, intersections, &mut room);
            open.open = Open::before(simd, |i| open.pixels[i][PLANES], first);
            for (k, (footprint, &intersection)) in footprints.iter().zip(intersections).enumerate().rev() {
                let position = first + k;
                if (position as f32) < last {
                    let halving = halving.get(intersection as usize).copied().unwrap_or_default();
                    out[position] = open.walk(&Half { footprint, halving }, position as f32);
                }
            }
        }
    }
}

/// A Gaussian and how it is halved.
struct Half<'a> {
    footprint: &'a Footprint,
    halving: [f32; 2],
}

/// A tile that is walked from behind.
struct OpenTile<'a, S: Simd> {
    simd: S,
    broadcast: Broadcast<S>,
    /// The planes, then the list position that ended each pixel.
    pixels: &'a mut [[S::f32s; PLANES + 1]],
    /// Pixel (x, y) of the upper left corner.
    origin: [usize; 2],
    /// What an error of 1 costs: of colour, of its square, of depth.
    per: [S::f32s; 3],
    open: Open,
    spans: Spans,
}

impl<S: Simd> OpenTile<'_, S> {
    /// The sums of one Gaussian over the tile; moves what is behind, and the transmittance, in front of it.
    #[inline(always)]
    fn walk<const M: usize>(&mut self, half: &Half<'_>, position: f32) -> [f32; M] {
        let Self { simd, ref broadcast, ref mut pixels, origin, per, ref open, ref mut spans } = *self;
        let [per_colour, per_square, per_depth] = per;
        let Half { footprint: f, halving } = half;
        let per_row = TILE_WIDTH / S::F32_LANES;
        let colour = f.colour.map(|c| simd.splat_f32s(c));
        let depth = simd.splat_f32s(f.depth);
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let (eps, most) = (simd.splat_f32s(EXPECTED_DEPTH_EPS), simd.splat_f32s(MOST_ODDS));
        let least = simd.splat_f32s(0.5 * ALPHA_MIN);
        let position = simd.splat_f32s(position);
        let mut sums = [zero; SUMS];
        for row in spans.set(simd, f, origin) {
            let (span, reached) = spans.row(row, S::F32_LANES);
            let mut vectors = reached & open.of(row);
            // `u` counts from the row's peak, which is `shear dy` beside the centre.
            let at_peak = halving[0] * f.shear * span.dy + halving[1] * span.dy;
            let (at_peak, along) = (simd.splat_f32s(-at_peak), simd.splat_f32s(-halving[0]));
            while let Some(vector) = next(&mut vectors) {
                let planes = &mut pixels[row * per_row + vector];
                let a = broadcast.alphas(simd, &span, f.curve_u, vector);
                let live = simd.and_m32s(a.drawn, simd.less_than_f32s(position, planes[PLANES]));
                let alpha = simd.select_f32s(live, a.alpha, zero);
                let through = simd.sub_f32s(one, alpha);
                let t = simd.div_f32s(planes[15], through);
                planes[15] = t;
                let w = simd.mul_f32s(alpha, t);
                let counted = planes[6];
                let w_counted = simd.mul_f32s(w, counted);
                let first = if M == SUMS {
                    let odds = exp2(simd, simd.min_f32s(most, simd.mul_add_f32s(along, a.u, at_peak)));
                    simd.mul_f32s(simd.div_f32s(one, simd.add_f32s(one, odds)), w_counted)
                } else {
                    zero
                };
                let (mut colours, mut linear) = (zero, zero);
                for c in 0..3 {
                    let behind = planes[10 + c];
                    let change = simd.mul_f32s(w, simd.sub_f32s(behind, colour[c]));
                    planes[10 + c] = simd.mul_add_f32s(through, behind, simd.mul_f32s(alpha, colour[c]));
                    let residual = planes[c];
                    let size = simd.abs_f32s(simd.add_f32s(residual, change));
                    let by_size = simd.mul_f32s(per_colour, simd.sub_f32s(size, simd.abs_f32s(residual)));
                    let by_square = simd.mul_f32s(per_square, simd.add_f32s(simd.add_f32s(residual, residual), change));
                    colours = simd.add_f32s(colours, simd.mul_add_f32s(by_square, change, by_size));
                    linear = simd.mul_add_f32s(planes[3 + c], change, linear);
                    if M == SUMS {
                        sums[3 + c] = simd.mul_add_f32s(first, residual, sums[3 + c]);
                        sums[6 + c] = simd.mul_add_f32s(w_counted, residual, sums[6 + c]);
                    }
                }
                let (depth_behind, alpha_behind) = (planes[13], planes[14]);
                planes[13] = simd.mul_add_f32s(through, depth_behind, simd.mul_f32s(alpha, depth));
                planes[14] = simd.mul_add_f32s(through, alpha_behind, alpha);
                let (drawn, drawn_alpha, truth) = (planes[8], planes[9], planes[7]);
                let new = simd.mul_add_f32s(w, simd.sub_f32s(depth_behind, depth), drawn);
                let new_alpha = simd.mul_add_f32s(w, simd.sub_f32s(alpha_behind, one), drawn_alpha);
                let before = simd.sub_f32s(simd.div_f32s(drawn, simd.max_f32s(drawn_alpha, eps)), truth);
                // What is left is nothing at all, or as much as one Gaussian shows at least: less is rounding.
                let left = simd.greater_than_f32s(new_alpha, least);
                let new = simd.select_f32s(left, simd.div_f32s(new, new_alpha), zero);
                let after = simd.sub_f32s(new, truth);
                let nearer = simd.sub_f32s(simd.abs_f32s(after), simd.abs_f32s(before));
                let known = simd.and_m32s(live, simd.greater_than_f32s(truth, zero));
                let by_depth = simd.select_f32s(known, simd.mul_f32s(per_depth, nearer), zero);
                let by_colour = simd.mul_add_f32s(counted, colours, linear);
                sums[0] = simd.add_f32s(sums[0], simd.add_f32s(by_colour, by_depth));
                sums[1] = simd.add_f32s(sums[1], w_counted);
                sums[2] = simd.mul_add_f32s(alpha, counted, sums[2]);
                if M == SUMS {
                    sums[9] = simd.mul_add_f32s(first, first, sums[9]);
                    sums[10] = simd.mul_add_f32s(first, w_counted, sums[10]);
                    sums[11] = simd.mul_add_f32s(w_counted, w_counted, sums[11]);
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
