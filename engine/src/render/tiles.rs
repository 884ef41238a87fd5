//! Which Gaussians a tile has to composite, nearest first.

use std::ops::RangeInclusive;

use lgs_formats::casts::to_u32;
use rayon::prelude::*;

use super::constants::{TILE_HEIGHT, TILE_WIDTH};
use super::project::{Footprint, Projector};
use super::tile_sort::{CHUNK, by_tile};
use crate::gaussians::physical::Splat;
use crate::parallel;
use crate::views::PinholeView;

/// The tile grid of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TileGrid {
    pub(super) columns: usize,
    pub(super) rows: usize,
}

/// The visible Gaussians by depth and the list of every tile.
#[derive(Clone, Debug)]
pub(super) struct TileLists {
    pub(super) grid: TileGrid,
    /// Visible Gaussians, nearest first, ties by index.
    pub(super) footprints: Vec<Footprint>,
    /// `[num_visible + 1]`: the intersections of visible Gaussian `v` are `places_of_splats[first_of_splat[v]..first_of_splat[v + 1]]`.
    pub(super) first_of_splat: Vec<u32>,
    /// Positions in `intersections`, by Gaussian and tile.
    pub(super) places_of_splats: Vec<u32>,
    /// `[num_tiles + 1]`: the list of tile `t` is `intersections[first_of_tile[t]..first_of_tile[t + 1]]`.
    pub(super) first_of_tile: Vec<u32>,
    /// Indices into `footprints`, by tile and depth.
    pub(super) intersections: Vec<u32>,
}

impl TileGrid {
    pub(super) fn of(view: &PinholeView) -> Self {
        Self { columns: view.width.div_ceil(TILE_WIDTH), rows: view.height.div_ceil(TILE_HEIGHT) }
    }

    pub(super) fn num_tiles(self) -> usize {
        self.columns * self.rows
    }

    /// Pixel (x, y) of the tile's upper left corner.
    pub(super) fn origin(self, tile: usize) -> [usize; 2] {
        [tile % self.columns * TILE_WIDTH, tile / self.columns * TILE_HEIGHT]
    }
}

impl TileLists {
    /// Indices into `footprints` of the Gaussians of a tile, nearest first.
    pub(super) fn intersections_of(&self, tile: usize) -> &[u32] {
        &self.intersections[self.first_of_tile[tile] as usize..self.first_of_tile[tile + 1] as usize]
    }
}

/// Bins footprints that are in depth order, by the tiles that each touches.
pub(super) fn bin(
    footprints: Vec<Footprint>,
    first_of_splat: Vec<u32>,
    tiles: Vec<u32>,
    view: &PinholeView,
) -> TileLists {
    let grid = TileGrid::of(view);
    let (first_of_tile, places_of_splats, intersections) = by_tile(&first_of_splat, tiles, grid.num_tiles());
    TileLists { grid, footprints, first_of_splat, places_of_splats, first_of_tile, intersections }
}

/// Footprints of the Gaussians that can reach a pixel, nearest first, ties by index; the first Gaussian has index `first`.
#[expect(clippy::cast_possible_truncation, reason = "a scene holds fewer than 2^32 Gaussians")]
pub(super) fn visible_by_depth(splats: &[Splat], first: usize, view: &PinholeView) -> Vec<Footprint> {
    let (projector, arch) = (Projector::new(view), pulp::Arch::new());
    let chunks: Vec<Vec<Footprint>> = parallel::map(splats.len().div_ceil(CHUNK), 1, &|chunk| {
        let splats = &splats[chunk * CHUNK..splats.len().min((chunk + 1) * CHUNK)];
        let mut visible = Vec::with_capacity(splats.len());
        let start = first + chunk * CHUNK;
        arch.dispatch(|| {
            let seen = splats.iter().enumerate().map(|(i, splat)| projector.footprint(splat, (start + i) as u32));
            seen.for_each(|footprint| visible.extend(footprint));
        });
        visible
    });
    let visible = chunks.concat();
    // Depths are positive: their bits order as they do. The index in the low half settles ties.
    let key = |i: usize| u64::from(visible[i].depth.to_bits()) << 32 | i as u64;
    let mut keys: Vec<u64> = parallel::map(visible.len(), CHUNK, &key);
    keys.par_sort_unstable();
    parallel::map(keys.len(), CHUNK, &|i| visible[(keys[i] & 0xffff_ffff) as usize])
}

/// Offsets per Gaussian and the tiles that each Gaussian touches.
pub(super) fn tiles_of_each(footprints: &[Footprint], view: &PinholeView) -> (Vec<u32>, Vec<u32>) {
    let (grid, arch) = (TileGrid::of(view), pulp::Arch::new());
    let pieces: Vec<(Vec<u32>, Vec<u32>)> = parallel::map(footprints.len().div_ceil(CHUNK), 1, &|chunk| {
        let chunk = &footprints[chunk * CHUNK..footprints.len().min((chunk + 1) * CHUNK)];
        let mut counts = Vec::with_capacity(chunk.len());
        let mut tiles = Vec::with_capacity(chunk.len() * 4);
        arch.dispatch(|| {
            for footprint in chunk {
                let before = tiles.len();
                push_tiles(footprint, view, grid, &mut tiles);
                counts.push(to_u32(tiles.len() - before));
            }
        });
        (counts, tiles)
    });
    let total: usize = pieces.iter().map(|(_, tiles)| tiles.len()).sum();
    let mut first_of_splat = Vec::with_capacity(footprints.len() + 1);
    let mut next = 0;
    first_of_splat.push(0);
    for count in pieces.iter().flat_map(|(counts, _)| counts) {
        next += count;
        first_of_splat.push(next);
    }
    let mut all = vec![0; total];
    let lengths = pieces.iter().map(|(_, tiles)| tiles.len());
    parallel::for_each(&mut parts(&mut all, lengths), 1, &|i, part| part.copy_from_slice(&pieces[i].1));
    (first_of_splat, all)
}

/// A slice in parts of these lengths, one behind the other.
pub(super) fn parts<T>(all: &mut [T], lengths: impl Iterator<Item = usize>) -> Vec<&mut [T]> {
    let mut rest = all;
    lengths
        .map(|len| {
            let (head, tail) = std::mem::take(&mut rest).split_at_mut(len);
            rest = tail;
            head
        })
        .collect()
}

/// Appends the tiles that the footprint's ellipse reaches, row of tiles by row of tiles.
#[inline(always)]
pub(super) fn push_tiles(f: &Footprint, view: &PinholeView, grid: TileGrid, tiles: &mut Vec<u32>) {
    visit_tiles(f, view, |row, columns| {
        let base = row * grid.columns;
        tiles.extend(columns.map(|column| to_u32(base + column)));
    });
}

/// Number of tiles that the footprint's ellipse reaches.
pub(super) fn count_tiles(f: &Footprint, view: &PinholeView) -> u64 {
    let mut count = 0;
    visit_tiles(f, view, |_, columns| count += (columns.end() + 1 - columns.start()) as u64);
    count
}

/// Gives `visit` every row of tiles that the footprint's ellipse reaches, with the columns.
#[inline(always)]
fn visit_tiles(f: &Footprint, view: &PinholeView, mut visit: impl FnMut(usize, RangeInclusive<usize>)) {
    let Some((y0, y1)) = pixel_span(f.mean_y - f.extent_y, f.mean_y + f.extent_y, view.height) else { return };
    let (first, last) = (y0 / TILE_HEIGHT, y1 / TILE_HEIGHT);
    for row in first..=last {
        let (left, right) = if first == last {
            (f.mean_x - f.extent_x, f.mean_x + f.extent_x)
        } else {
            let top = (row * TILE_HEIGHT) as f32 + 0.5 - f.mean_y;
            let bottom = top + (TILE_HEIGHT - 1) as f32;
            let (top, bottom) = (top.max(-f.extent_y), bottom.min(f.extent_y));
            (f.edge(-f.widest_y, top, bottom, -1.0), f.edge(f.widest_y, top, bottom, 1.0))
        };
        if let Some((x0, x1)) = pixel_span(left, right, view.width) {
            visit(row, x0 / TILE_WIDTH..=x1 / TILE_WIDTH);
        }
    }
}

impl Footprint {
    /// Rows of the tile whose first image row is `top` that the footprint can reach.
    #[inline(always)]
    pub(super) fn rows_in(&self, top: usize) -> std::ops::Range<usize> {
        let y = self.mean_y - top as f32;
        match pixel_span(y - self.extent_y, y + self.extent_y, TILE_HEIGHT) {
            Some((first, last)) => first..last + 1,
            None => 0..0,
        }
    }

    /// Whether this one stands in front of another in the order of compositing.
    pub(super) fn is_before(&self, other: &Self) -> bool {
        (self.depth, self.index) < (other.depth, other.index)
    }

    /// The outermost x of the ellipse between the heights `top` and `bottom`, to the right (`side` 1) or left (-1).
    #[inline(always)]
    fn edge(&self, widest: f32, top: f32, bottom: f32, side: f32) -> f32 {
        let dy = widest.max(top).min(bottom);
        let half = self.half_width(dy);
        // Rounding may not lose a pixel.
        self.mean_x + self.shear * dy + side * (half + 1e-3 + 1e-5 * self.extent_x)
    }
}

/// First and last index of the pixels whose centres lie in `low..=high`; `None` when there is none inside the image.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the image before the cast")]
pub(super) fn pixel_span(low: f32, high: f32, size: usize) -> Option<(usize, usize)> {
    let first = (low - 0.5).ceil().max(0.0);
    let last = (high - 0.5).floor().min(size as f32 - 1.0);
    (first <= last).then_some((first as usize, last as usize))
}
