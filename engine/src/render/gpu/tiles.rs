//! Which Gaussians a tile has to composite, nearest first: visible ones by depth, their intersections by tile.

use wgpu::Buffer;

use super::error::GpuError;
use super::kernels::Kernel;
use super::project::{PROJECTION, Projection, REACH, SceneBuffers};
use super::sort::{Sorted, scan, sort};
use super::told::Told;
use super::work::{Work, groups_over};

const TILES: &[&str] = &[PROJECTION, REACH, include_str!("tiles.wgsl")];
const LIST_VISIBLE: Kernel = Kernel::new("list_visible", TILES);
const COUNT_IN_ORDER: Kernel = Kernel::new("count_in_order", TILES);
const INTERSECT: Kernel = Kernel::new("intersect", TILES);
const FIND_RANGES: Kernel = Kernel::new("find_ranges", &[include_str!("ranges.wgsl")]);

/// Bits of a depth.
const DEPTH_BITS: u32 = 32;

/// The lists of a view.
#[derive(Debug)]
pub(super) struct TileLists {
    pub(super) num_tiles: u32,
    /// The camera, with its counts.
    pub(super) camera: Told,
    /// `[num_visible]` indices, nearest first.
    pub(super) visible: Buffer,
    /// `[num_visible + 1]` first intersection of each.
    pub(super) first_of_splat: Buffer,
    /// `[num_tiles + 1]` first place of each tile.
    pub(super) first_of_tile: Buffer,
    /// Index of the Gaussian at each place.
    pub(super) intersections: Buffer,
    /// Place of each intersection.
    pub(super) places: Buffer,
}

impl Work<'_> {
    /// The lists of a projected view; marks the visible Gaussians as seen.
    pub(super) fn bin(&mut self, scene: &SceneBuffers, projection: &Projection) -> Result<TileLists, GpuError> {
        let [visible, all] = [projection.num_visible, projection.num_intersections];
        let [_, _, columns, rows] = projection.camera.size;
        let num_tiles = columns * rows;
        let camera = self.tell(&projection.camera);
        let [of_visible, of_all] = [visible, all].map(|len| len as usize);
        let depths = self.pair(["depths", "indices"], of_visible)?;
        let bindings = [
            (1, &projection.footprints),
            (2, &projection.places),
            (4, &depths.keys),
            (5, &depths.payloads),
            (7, &scene.gradients),
        ];
        self.run(&LIST_VISIBLE, &[&camera], &bindings, groups_over(projection.camera.count[0]));
        let spare = self.pair(["spare depths", "spare indices"], of_visible)?;
        let by_depth = sort(self, depths, spare, visible, DEPTH_BITS)?;
        let first_of_splat = self.buffer::<u32>("first of each", of_visible + 1)?;
        let bindings = [(2, &by_depth.payloads), (3, &projection.places), (4, &first_of_splat)];
        self.run(&COUNT_IN_ORDER, &[&camera], &bindings, groups_over(visible + 1));
        scan(self, &first_of_splat, visible + 1)?;
        let tiles = self.pair(["tiles", "numbers"], of_all)?;
        let owners = self.buffer::<u32>("owners", of_all)?;
        let bindings = [
            (1, &projection.footprints),
            (2, &by_depth.payloads),
            (3, &first_of_splat),
            (4, &tiles.keys),
            (5, &tiles.payloads),
            (6, &owners),
        ];
        self.run(&INTERSECT, &[&camera], &bindings, groups_over(visible));
        let spare = self.pair(["spare tiles", "spare numbers"], of_all)?;
        let by_tile = sort(self, tiles, spare, all, u32::BITS - num_tiles.leading_zeros())?;
        let first_of_tile = self.buffer::<u32>("first of each tile", num_tiles as usize + 1)?;
        let intersections = self.buffer::<u32>("intersections", of_all)?;
        let places = self.buffer::<u32>("places", of_all)?;
        let size = self.tell(&[all, num_tiles, 0, 0]);
        let bindings = [
            (1, &by_tile.keys),
            (2, &by_tile.payloads),
            (3, &owners),
            (4, &first_of_tile),
            (5, &intersections),
            (6, &places),
        ];
        self.run(&FIND_RANGES, &[&size], &bindings, groups_over(all + 1));
        Ok(TileLists {
            num_tiles,
            camera,
            visible: by_depth.payloads,
            first_of_splat,
            first_of_tile,
            intersections,
            places,
        })
    }

    fn pair(&mut self, [keys, payloads]: [&'static str; 2], len: usize) -> Result<Sorted, GpuError> {
        Ok(Sorted { keys: self.buffer::<u32>(keys, len)?, payloads: self.buffer::<u32>(payloads, len)? })
    }
}
