//! The gradient of a drawn view, and sums of two maps under every Gaussian's blending weights.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use lgs_formats::casts::to_u32;
use wgpu::Buffer;

use super::super::ImageGradient;
use super::error::GpuError;
use super::forward::Drawn;
use super::kernels::{Kernel, MAPPED, ROW, SEEN, SUMS, count};
use super::project::{PROJECTION, SceneBuffers};
use super::walk::{WALK, WALK_BACK};
use super::work::{Work, groups_over};
use crate::gaussians::physical::SplatGradient;
use crate::parallel;

const UNCOMPOSITE: &[&str] = &[WALK, WALK_BACK, include_str!("backward.wgsl")];
const UNCOMPOSITE_64: Kernel =
    Kernel { name: "uncomposite 64", entry: "uncomposite", sources: UNCOMPOSITE, constants: || count("THREADS", 64) };
const UNCOMPOSITE_128: Kernel =
    Kernel { name: "uncomposite 128", constants: || count("THREADS", 128), ..UNCOMPOSITE_64 };
const UNCOMPOSITE_256: Kernel =
    Kernel { name: "uncomposite 256", constants: || count("THREADS", 256), ..UNCOMPOSITE_64 };
const BACK: &[&str] = &[PROJECTION, include_str!("project_backward.wgsl")];
const SUM_TILES: Kernel = Kernel::new("sum_tiles", BACK);
const PROJECT_BACK: Kernel = Kernel::new("project_back", BACK);

const SUMS_NAME: &str = "sums of intersections";
/// Bytes of an intersection's sums.
const SUMS_BYTES: u64 = (SUMS * size_of::<f32>()) as u64;

/// What the sums of a batch are told.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Back {
    /// First place and places, and whether a batch is the first.
    batch: [u32; 4],
    factor: [f32; 4],
}

/// Tiles whose sums are held at the same time, and their places.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Batch {
    pub(super) tiles: Range<u32>,
    pub(super) places: Range<u32>,
}

/// What one Gaussian's row says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Row {
    /// By physical values.
    pub(crate) gradient: SplatGradient,
    /// Sums of the two maps.
    pub(crate) mapped: [f32; 2],
    /// Whether a view shows it.
    pub(crate) is_seen: bool,
}

impl Work<'_> {
    /// Adds `factor` times a view's gradient to rows, and the sums of its maps.
    ///
    /// # Shapes
    /// `gradients` `[H, W, 2, 4]`: by colours and expected depth; by accumulated alpha and depth, then two maps. `rows` `[N, ROW]`.
    ///
    /// # Errors
    /// Where it does not fit, or the GPU has stopped.
    pub(crate) fn add_backward(
        &mut self,
        scene: &SceneBuffers,
        drawn: &Drawn,
        gradients: &Buffer,
        rows: &Buffer,
        factor: f32,
    ) -> Result<(), GpuError> {
        if drawn.num_intersections == 0 {
            return Ok(());
        }
        let batches = self.batches(drawn, SUMS_NAME, SUMS_BYTES)?;
        let room = batches.iter().map(|batch| batch.places.len()).max().unwrap_or(0);
        let sums = self.buffer::<[f32; SUMS]>(SUMS_NAME, room)?;
        let totals = self.buffer::<[f32; SUMS]>("sums of Gaussians", drawn.num_visible as usize)?;
        let lists = &drawn.lists;
        let over_visible = groups_over(drawn.num_visible);
        for (number, Batch { tiles, places }) in batches.iter().enumerate() {
            let told = self.tell(&drawn.walk_back(tiles, places.start));
            let bindings = [
                (1, &drawn.footprints),
                (2, &lists.first_of_tile),
                (3, &lists.intersections),
                (4, &drawn.image),
                (5, &drawn.ends),
                (6, gradients),
                (7, &sums),
            ];
            self.run(uncomposite(lists.num_tiles), &[&told], &bindings, tiles.end - tiles.start);
            let batch = [places.start, places.end - places.start, u32::from(number == 0), 0];
            let back = self.tell(&Back { batch, factor: [factor, 0.0, 0.0, 0.0] });
            let bindings = [(3, &lists.first_of_splat), (4, &lists.places), (5, &sums), (6, &totals)];
            self.run(&SUM_TILES, &[&lists.camera, &back], &bindings, over_visible);
        }
        let back = self.tell(&Back { batch: [0; 4], factor: [factor, 0.0, 0.0, 0.0] });
        let bindings = [(2, &lists.visible), (6, &totals), (7, &scene.shapes), (8, &scene.looks), (9, rows)];
        self.run(&PROJECT_BACK, &[&lists.camera, &back], &bindings, over_visible);
        Ok(())
    }

    /// Tiles in runs of as many places as a buffer has room for, each of so many bytes; one run where all fit, none where there are no places.
    ///
    /// # Errors
    /// Where one tile has more, or the GPU has stopped.
    pub(super) fn batches(&mut self, drawn: &Drawn, name: &'static str, bytes: u64) -> Result<Vec<Batch>, GpuError> {
        let limit = self.most_bytes(name);
        let most = u32::try_from(limit / bytes).unwrap_or(u32::MAX);
        let num_tiles = drawn.lists.num_tiles;
        if drawn.num_intersections == 0 {
            return Ok(Vec::new());
        }
        if drawn.num_intersections <= most {
            return Ok(vec![Batch { tiles: 0..num_tiles, places: 0..drawn.num_intersections }]);
        }
        let first = self.read::<u32>(&drawn.lists.first_of_tile, 0, num_tiles as usize + 1)?;
        let need = u64::from(drawn.num_intersections) * bytes;
        runs(&first, most).ok_or(GpuError::TooLarge { what: "sums of a tile", need, limit })
    }

    /// `[H, W, 2, 4]` of a gradient by a view's images, and of two maps; empty vectors stand for zeros.
    ///
    /// # Errors
    /// As [`Work::buffer`].
    pub(super) fn upload_gradient(
        &mut self,
        drawn: &Drawn,
        gradient: &ImageGradient,
        maps: [&[f32]; 2],
    ) -> Result<Buffer, GpuError> {
        let at = |values: &[f32], i: usize| values.get(i).copied().unwrap_or(0.0);
        let of_pixel = |p: usize| {
            let [r, g, b] = [0, 1, 2].map(|c| at(&gradient.rgb, 3 * p + c));
            let rest = [at(&gradient.alpha, p), at(&gradient.depth, p), at(maps[0], p), at(maps[1], p)];
            [[r, g, b, at(&gradient.expected_depth, p)], rest]
        };
        let values: Vec<[[f32; 4]; 2]> = parallel::map(drawn.num_pixels(), 1, &of_pixel);
        self.upload("gradients of pixels", &values)
    }

    /// What rows say.
    ///
    /// # Errors
    /// [`GpuError::Lost`] where the GPU has stopped.
    pub(super) fn read_rows(&mut self, rows: &Buffer, len: usize) -> Result<Vec<Row>, GpuError> {
        let read = self.read::<[f32; ROW]>(rows, 0, len)?;
        Ok(parallel::map(read.len(), 1, &|i| Row::of(&read[i])))
    }
}

impl Row {
    fn of(row: &[f32; ROW]) -> Self {
        let gradient = row.first_chunk().map(Self::gradient_of).unwrap_or_default();
        Self { gradient, mapped: [row[MAPPED], row[MAPPED + 1]], is_seen: row[SEEN] > 0.0 }
    }

    /// The gradient that the first numbers of a row are.
    pub(crate) fn gradient_of(row: &[f32; MAPPED]) -> SplatGradient {
        SplatGradient {
            mean: std::array::from_fn(|k| row[k]),
            quat: std::array::from_fn(|k| row[3 + k]),
            scale: std::array::from_fn(|k| row[7 + k]),
            opacity: row[10],
            colour: std::array::from_fn(|k| row[11 + k]),
            velocity: std::array::from_fn(|k| row[14 + k]),
        }
    }
}

/// The kernel for a view of so many tiles: a large GPU has some thousand groups of 64 at work at a time, and where there are fewer tiles, more threads
/// share each.
fn uncomposite(num_tiles: u32) -> &'static Kernel {
    match num_tiles {
        0..1024 => &UNCOMPOSITE_256,
        1024..4096 => &UNCOMPOSITE_128,
        _ => &UNCOMPOSITE_64,
    }
}

/// Runs of tiles of at most `most` places; `None` where one tile has more.
fn runs(first_of_tile: &[u32], most: u32) -> Option<Vec<Batch>> {
    let mut batches = Vec::new();
    let mut start = 0;
    while start + 1 < first_of_tile.len() {
        let places = first_of_tile[start];
        let end = first_of_tile.partition_point(|&first| first - places.min(first) <= most) - 1;
        if end <= start {
            return None;
        }
        batches.push(Batch { tiles: to_u32(start)..to_u32(end), places: places..first_of_tile[end] });
        start = end;
    }
    Some(batches)
}

#[cfg(test)]
mod tests {
    use super::{Batch, runs};

    #[test]
    fn runs_of_tiles_fit_and_leave_none_out() {
        let first = [0, 3, 3, 7, 12, 12, 15];
        let batch = |tiles, places| Batch { tiles, places };
        assert_eq!(runs(&first, 100), Some(vec![batch(0..6, 0..15)]));
        assert_eq!(runs(&first, 7), Some(vec![batch(0..3, 0..7), batch(3..5, 7..12), batch(5..6, 12..15)]));
        assert_eq!(
            runs(&first, 5),
            Some(vec![batch(0..2, 0..3), batch(2..3, 3..7), batch(3..5, 7..12), batch(5..6, 12..15)])
        );
        assert_eq!(runs(&first, 4), None);
    }
}
