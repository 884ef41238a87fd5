//! What a single Gaussian changes: only the tiles that it touches are composited again.

use super::constants::{TILE_HEIGHT, TILE_PIXELS, TILE_WIDTH, TRANSMITTANCE_MIN};
use super::forward::{CompositeTile, PLANES, TRANSMITTANCE};
use super::project::{Footprint, Projector};
use super::tiles::push_tiles;
use super::{Rendered, RenderedWithState};
use crate::gaussians::physical::Splat;
use crate::views::PinholeView;

/// A rendered image whose single Gaussians are changed one at a time.
#[derive(Debug)]
pub struct Redraw<'a> {
    state: &'a RenderedWithState,
    view: &'a PinholeView,
    /// `[num_gaussians]` place among the visible ones; `u32::MAX` for one that is not.
    place_of: Vec<u32>,
}

/// A rectangle of changed pixels, with new values.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    /// First column and row.
    pub corner: [usize; 2],
    /// The new images of the rectangle.
    pub images: Rendered,
}

impl<'a> Redraw<'a> {
    /// Single changes of a rendered set of `num_gaussians`.
    pub fn new(state: &'a RenderedWithState, view: &'a PinholeView, num_gaussians: usize) -> Self {
        let mut place_of = vec![u32::MAX; num_gaussians];
        (0_u32..).zip(&state.lists.footprints).for_each(|(place, f)| place_of[f.index as usize] = place);
        Self { state, view, place_of }
    }

    /// What changes when the Gaussian is taken out; `None` when no pixel does.
    pub fn without(&self, index: usize) -> Option<Patch> {
        let place = *self.place_of.get(index).filter(|&&place| place != u32::MAX)?;
        let lists = &self.state.lists;
        let mut tiles = Vec::new();
        push_tiles(&lists.footprints[place as usize], self.view, lists.grid, &mut tiles);
        self.patch(&tiles, |intersections| {
            let kept = intersections.iter().filter(|&&intersection| intersection != place);
            kept.map(|&intersection| lists.footprints[intersection as usize]).collect()
        })
    }

    /// What changes when a Gaussian is added behind all others in the order of indices; `None` when no pixel does.
    pub fn with(&self, splat: &Splat) -> Option<Patch> {
        let lists = &self.state.lists;
        let new = Projector::new(self.view).footprint(splat, u32::MAX)?;
        let mut tiles = Vec::new();
        push_tiles(&new, self.view, lists.grid, &mut tiles);
        self.patch(&tiles, |intersections| {
            let mut list: Vec<Footprint> =
                intersections.iter().map(|&intersection| lists.footprints[intersection as usize]).collect();
            list.insert(list.partition_point(|old| old.is_before(&new)), new);
            list
        })
    }

    /// The rectangle around the pixels that change when the tiles' lists become those of `list_of`.
    fn patch(&self, tiles: &[u32], list_of: impl Fn(&[u32]) -> Vec<Footprint>) -> Option<Patch> {
        let lists = &self.state.lists;
        let arch = pulp::Arch::new();
        let mut bounds = Bounds::default();
        let mut redrawn: Vec<([usize; 2], Vec<f32>)> = Vec::with_capacity(tiles.len());
        for &tile in tiles {
            let tile = tile as usize;
            let origin = lists.grid.origin(tile);
            let footprints = list_of(lists.intersections_of(tile));
            let intersections: Vec<u32> = (0..).take(footprints.len()).collect();
            let mut planes = vec![0.0; PLANES * TILE_PIXELS];
            arch.dispatch(CompositeTile {
                footprints: &footprints,
                intersections: &intersections,
                origin,
                planes: &mut planes,
                opaque: TRANSMITTANCE_MIN,
            });
            let old = &self.state.tiles[tile * PLANES * TILE_PIXELS..][..PLANES * TILE_PIXELS];
            bounds.add_changes(old, &planes, origin, [self.view.width, self.view.height]);
            redrawn.push((origin, planes));
        }
        let [width, height] = bounds.size()?;
        let mut patch = Patch { corner: bounds.low, images: crop(&self.state.images, bounds.low, [width, height]) };
        for (origin, planes) in &redrawn {
            patch.overwrite(*origin, planes, self.state.background);
        }
        Some(patch)
    }
}

impl Patch {
    /// Writes the pixels of a tile that lie in the rectangle.
    fn overwrite(&mut self, origin: [usize; 2], planes: &[f32], background: [f32; 3]) {
        let Rendered { width, height, rgb, alpha, depth } = &mut self.images;
        for y in 0..*height {
            for x in 0..*width {
                let (column, row) =
                    ((self.corner[0] + x).wrapping_sub(origin[0]), (self.corner[1] + y).wrapping_sub(origin[1]));
                if column >= TILE_WIDTH || row >= TILE_HEIGHT {
                    continue;
                }
                let value = |plane: usize| planes[plane * TILE_PIXELS + row * TILE_WIDTH + column];
                let t = value(TRANSMITTANCE).abs();
                let i = y * *width + x;
                for c in 0..3 {
                    rgb[3 * i + c] = value(c) + t * background[c];
                }
                alpha[i] = 1.0 - t;
                depth[i] = value(3);
            }
        }
    }
}

/// The part of a rendered image that starts at a corner (column, row).
pub(crate) fn crop(images: &Rendered, corner: [usize; 2], [width, height]: [usize; 2]) -> Rendered {
    let rows = |plane: &[f32], channels: usize| -> Vec<f32> {
        let from = |y: usize| ((corner[1] + y) * images.width + corner[0]) * channels;
        (0..height).flat_map(|y| plane[from(y)..from(y) + width * channels].iter().copied()).collect()
    };
    Rendered { width, height, rgb: rows(&images.rgb, 3), alpha: rows(&images.alpha, 1), depth: rows(&images.depth, 1) }
}

/// The rectangle around changed pixels.
struct Bounds {
    low: [usize; 2],
    /// One beyond the last.
    high: [usize; 2],
}

impl Default for Bounds {
    fn default() -> Self {
        Self { low: [usize::MAX; 2], high: [0; 2] }
    }
}

impl Bounds {
    fn size(&self) -> Option<[usize; 2]> {
        (self.low[0] < self.high[0]).then(|| [0, 1].map(|k| self.high[k] - self.low[k]))
    }

    /// Takes in the pixels of a tile whose drawn values (the transmittance without its mark) differ.
    fn add_changes(&mut self, old: &[f32], new: &[f32], origin: [usize; 2], size: [usize; 2]) {
        for pixel in 0..TILE_PIXELS {
            let at = [origin[0] + pixel % TILE_WIDTH, origin[1] + pixel / TILE_WIDTH];
            let differs = |plane: usize| {
                let i = plane * TILE_PIXELS + pixel;
                old[i].abs() != new[i].abs()
            };
            if at[0] < size[0] && at[1] < size[1] && (0..=TRANSMITTANCE).any(differs) {
                for (k, &place) in at.iter().enumerate() {
                    self.low[k] = self.low[k].min(place);
                    self.high[k] = self.high[k].max(place + 1);
                }
            }
        }
    }
}
