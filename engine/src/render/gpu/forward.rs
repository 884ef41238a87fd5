//! A view, drawn: images and the state that its gradient needs, all of it on the GPU.

use std::ops::Range;

use lgs_formats::casts::to_u32;
use rayon::prelude::*;
use wgpu::Buffer;

use super::super::Rendered;
use super::super::constants::{TILE_PIXELS, TRANSMITTANCE_MIN};
use super::error::GpuError;
use super::kernels::Kernel;
use super::project::SceneBuffers;
use super::tiles::TileLists;
use super::walk::{WALK, Walk};
use super::work::Work;
use crate::views::PinholeView;

const COMPOSITE: Kernel = Kernel::new("composite", &[WALK, include_str!("forward.wgsl")]);
/// Groups of 256 that share a tile.
const HALVES: usize = TILE_PIXELS / 256;

/// A drawn view.
#[derive(Debug)]
pub(crate) struct Drawn {
    /// Width and height, pixels.
    pub(crate) size: [u32; 2],
    /// `[H, W]` colours and accumulated depths.
    pub(crate) image: Buffer,
    /// `[H, W]` transmittances, and the list positions that ended the pixels.
    pub(crate) ends: Buffer,
    /// Visible Gaussians.
    pub(crate) num_visible: u32,
    /// Intersections of a Gaussian and a tile.
    pub(crate) num_intersections: u32,
    pub(super) background: [f32; 3],
    pub(super) footprints: Buffer,
    pub(super) lists: TileLists,
    pub(super) columns: u32,
}

impl Drawn {
    /// A walk back over some tiles, whose first place is given.
    pub(super) fn walk_back(&self, tiles: &Range<u32>, first_place: u32) -> Walk {
        let [r, g, b] = self.background;
        Walk {
            size: [self.size[0], self.size[1], self.columns, self.lists.num_tiles],
            background: [r, g, b, 0.0],
            batch: [tiles.start, tiles.end - tiles.start, first_place, 0],
            ..Walk::default()
        }
    }

    /// Pixels.
    pub(crate) const fn num_pixels(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }
}

impl Work<'_> {
    /// Draws a view over a background colour, and marks the Gaussians that it shows.
    ///
    /// # Errors
    /// Where it does not fit, or the GPU has stopped.
    pub(crate) fn draw(
        &mut self,
        scene: &SceneBuffers,
        view: &PinholeView,
        background: [f32; 3],
    ) -> Result<Drawn, GpuError> {
        self.draw_through(scene, view, background, TRANSMITTANCE_MIN)
    }

    /// As [`Work::draw`], compositing also what is behind opaque Gaussians, until a transmittance of `least`.
    ///
    /// # Errors
    /// As [`Work::draw`].
    pub(crate) fn draw_through(
        &mut self,
        scene: &SceneBuffers,
        view: &PinholeView,
        background: [f32; 3],
        least: f32,
    ) -> Result<Drawn, GpuError> {
        let projection = self.project(scene, view)?;
        let lists = self.bin(scene, &projection)?;
        let [width, height, columns, _] = projection.camera.size;
        let pixels = view.num_pixels();
        let image = self.buffer::<[f32; 4]>("image", pixels)?;
        let ends = self.buffer::<[f32; 2]>("ends of pixels", pixels)?;
        let [r, g, b] = background;
        let size = [width, height, columns, lists.num_tiles];
        let told = self.tell(&Walk { size, background: [r, g, b, least], ..Walk::default() });
        let bindings = [
            (1, &projection.footprints),
            (2, &lists.first_of_tile),
            (3, &lists.intersections),
            (4, &image),
            (5, &ends),
        ];
        self.run(&COMPOSITE, &[&told], &bindings, to_u32(HALVES) * lists.num_tiles);
        Ok(Drawn {
            size: [width, height],
            image,
            ends,
            num_visible: projection.num_visible,
            num_intersections: projection.num_intersections,
            background,
            footprints: projection.footprints,
            lists,
            columns,
        })
    }

    /// `[H, W, 3]` colours of a drawn view.
    ///
    /// # Errors
    /// [`GpuError::Lost`] where the GPU has stopped.
    pub(crate) fn colours(&mut self, drawn: &Drawn) -> Result<Vec<f32>, GpuError> {
        let image = self.read::<[f32; 4]>(&drawn.image, 0, drawn.num_pixels())?;
        Ok(colours_of(&image))
    }

    /// The images of a drawn view.
    ///
    /// # Errors
    /// [`GpuError::Lost`] where the GPU has stopped.
    pub(crate) fn images(&mut self, drawn: &Drawn) -> Result<Rendered, GpuError> {
        let pixels = drawn.num_pixels();
        let image = self.read::<[f32; 4]>(&drawn.image, 0, pixels)?;
        let ends = self.read::<[f32; 2]>(&drawn.ends, 0, pixels)?;
        Ok(Rendered {
            width: drawn.size[0] as usize,
            height: drawn.size[1] as usize,
            rgb: colours_of(&image),
            alpha: ends.iter().map(|[transmittance, _]| 1.0 - transmittance).collect(),
            depth: image.iter().map(|[_, _, _, depth]| *depth).collect(),
        })
    }
}

fn colours_of(image: &[[f32; 4]]) -> Vec<f32> {
    let colours: Vec<[f32; 3]> = image.par_iter().map(|&[r, g, b, _]| [r, g, b]).collect();
    colours.into_flattened()
}
