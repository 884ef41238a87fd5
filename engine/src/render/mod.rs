//! Exact differentiable splatting of 3D Gaussians on the CPU.
//!
//! Passes, one file each: `project` (f64, one Gaussian), `tiles` (depth order, tile lists), `forward` (compositing), `backward`
//! (sums over pixels), `project_backward` (chain rule of the projection). A tile is composited by one thread, a vector of pixels of one
//! row at a time: only where the Gaussian can reach the minimum alpha (`spans`) and a pixel has not ended (`open`), with all that is known
//! of these pixels side by side (`pixels`). Every intersection of a Gaussian and a tile has a place of its
//! own for its sums, so results are the same bits for any number of threads.
//!
//! `memory_estimate` tells how much the lists of a view will hold before they are made.
//!
//! Interventions: `branch` (sets that differ in some Gaussians share their projections), `patch` (what one Gaussian changes, by its
//! tiles alone), `blended` (maps summed under every Gaussian's blending weights).
//!
//! # Source
//! Zwicker et al., EWA splatting, 2001; Kerbl et al., 3D Gaussian splatting, 2023; conventions of gsplat (see `constants`).

pub mod constants;

mod backward;
mod blended;
mod branch;
mod device;
mod effects;
mod forward;
#[cfg(feature = "gpu")]
pub mod gpu;
mod halving;
mod lanes;
mod memory_estimate;
mod open;
mod patch;
mod pixels;
mod places;
mod project;
mod project_backward;
mod spans;
mod tile_sort;
mod tiles;

use crate::gaussians::physical::{Splat, SplatGradient};
use crate::parallel;
use crate::views::PinholeView;
pub use blended::{MAPS, blended_sums};
pub use branch::Projection;
use constants::TILE_PIXELS;
pub use device::{Device, DeviceChoice, DrawnOn, devices};
pub use effects::{Effect, PixelCosts, effects};
use forward::{PLANES, STOP};
pub use halving::{halving, longest_axes};
pub use memory_estimate::{MemoryEstimate, Pass};
pub(crate) use patch::crop;
pub use patch::{Patch, Redraw};
pub use places::Places;
use tiles::TileLists;

pub mod reference;

/// Pixels that a thread takes at once.
const GRAIN: usize = 4096;

/// A rendered image.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendered {
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
    /// `[H, W, 3]` colours over the background colour.
    pub rgb: Vec<f32>,
    /// `[H, W]` accumulated alpha, `1 - T`.
    pub alpha: Vec<f32>,
    /// `[H, W]` accumulated depth, `sum w z`, metres.
    pub depth: Vec<f32>,
}

/// Gradients of a scalar by the images of a [`Rendered`]; an empty vector stands for zeros.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImageGradient {
    /// `[H, W, 3]` by the colours.
    pub rgb: Vec<f32>,
    /// `[H, W]` by the accumulated alpha.
    pub alpha: Vec<f32>,
    /// `[H, W]` by the accumulated depth.
    pub depth: Vec<f32>,
    /// `[H, W]` by the expected depth, `depth / max(alpha, 1e-10)`.
    pub expected_depth: Vec<f32>,
}

impl Rendered {
    /// `[H, W]` expected depth, `depth / max(alpha, 1e-10)`, metres; 0 where nothing was drawn.
    pub fn expected_depth(&self) -> Vec<f32> {
        let mut expected = vec![0.0; self.depth.len()];
        parallel::for_chunks(&mut expected, GRAIN, &|number, part| {
            let drawn = self.depth[number * GRAIN..].iter().zip(&self.alpha[number * GRAIN..]);
            part.iter_mut().zip(drawn).for_each(|(expected, (d, a))| *expected = d / a.max(1e-10));
        });
        expected
    }
}

/// A rendered image with what its gradient needs.
#[derive(Debug)]
pub struct RenderedWithState {
    /// The images.
    pub images: Rendered,
    lists: TileLists,
    tiles: Vec<f32>,
    background: [f32; 3],
}

impl RenderedWithState {
    /// Indices of the Gaussians that can reach a pixel, nearest first.
    pub fn visible(&self) -> impl Iterator<Item = usize> + '_ {
        self.lists.footprints.iter().map(|footprint| footprint.index as usize)
    }

    /// What compositing left of a tile.
    fn planes_of(&self, tile: usize) -> &[f32] {
        let planes = PLANES * TILE_PIXELS;
        &self.tiles[tile * planes..(tile + 1) * planes]
    }

    /// List position that ended each pixel of a tile.
    fn stops_of(&self, tile: usize) -> &[f32] {
        &self.planes_of(tile)[STOP * TILE_PIXELS..]
    }

    /// Number of intersections of a Gaussian and a tile that it can reach.
    pub fn num_intersections(&self) -> usize {
        self.lists.intersections.len()
    }
}

/// The images of the Gaussians at the view's moment, over a background colour.
///
/// # Shapes
/// `splats` `[N]`, clip frame; images `[H, W, ..]` as [`Rendered`] says.
///
/// # Formula
/// `rgb = sum_i w_i c_i + T background`, `w_i = alpha_i T_i`, `T_i = prod_{j<i} (1 - alpha_j)`, `alpha = min(0.999, o exp(-sigma))`,
/// `sigma = d^T (J W Sigma W^T J^T + 0.3 I)^-1 d / 2`. Gaussians with a parameter that is not finite are not drawn.
pub fn render(splats: &[Splat], view: &PinholeView, background: [f32; 3]) -> Rendered {
    render_for_gradient(splats, view, background).images
}

/// As [`render`], with the state that [`backward`] needs.
pub fn render_for_gradient(splats: &[Splat], view: &PinholeView, background: [f32; 3]) -> RenderedWithState {
    Projection::new(splats, view).render(view, background)
}

/// Gradients of a scalar by the physical values of all Gaussians, from its gradients by the images.
///
/// # Shapes
/// Result `[N]`, in the order of `splats`.
///
/// # Gradient
/// Exact, of the function that [`render`] computes; the depth order and which pixels a Gaussian reaches are constants, the
/// camera is a constant.
pub fn backward(
    splats: &[Splat],
    view: &PinholeView,
    state: &RenderedWithState,
    gradient: &ImageGradient,
) -> Vec<SplatGradient> {
    let mut all = vec![SplatGradient::default(); splats.len()];
    for (i, of_visible) in state.visible().zip(backward_visible(splats, view, state, gradient)) {
        all[i] = of_visible;
    }
    all
}

/// As [`backward`], of the visible Gaussians alone: all others have none.
///
/// # Shapes
/// Result `[num_visible]`, in the order of [`RenderedWithState::visible`].
pub fn backward_visible(
    splats: &[Splat],
    view: &PinholeView,
    state: &RenderedWithState,
    gradient: &ImageGradient,
) -> Vec<SplatGradient> {
    backward_with_sums(splats, view, state, gradient, []).0
}

/// As [`backward_visible`], and the sums of M of [`MAPS`] maps that [`blended_sums`] tells, on the same way over the tiles.
///
/// # Shapes
/// `maps` of `[H, W]`; results `[num_visible]` and `[num_visible, M]`.
pub fn backward_with_sums<const M: usize>(
    splats: &[Splat],
    view: &PinholeView,
    state: &RenderedWithState,
    gradient: &ImageGradient,
    maps: [&[f32]; M],
) -> (Vec<SplatGradient>, Vec<[f64; M]>) {
    let (moments, sums) = backward::moments(state, gradient, maps);
    (project_backward::gradients(splats, view, &state.lists, &moments), blended::over_tiles(&state.lists, &sums))
}
