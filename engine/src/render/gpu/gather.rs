//! What crosses back of rows: those of the Gaussians that a view shows, and of them the numbers that are needed.

use std::ops::Range;

use lgs_formats::casts::to_u32;
use wgpu::Buffer;

use super::error::GpuError;
use super::kernels::Kernel;
use super::project::SceneBuffers;
use super::sort::scan;
use super::work::{Work, groups_over};

const GATHER: &[&str] = &[include_str!("gather.wgsl")];
const FLAG_SEEN: Kernel = Kernel::new("flag_seen", GATHER);
const LIST_SEEN: Kernel = Kernel::new("list_seen", GATHER);
const PACK_ROWS: Kernel = Kernel::new("pack_rows", GATHER);

/// The Gaussians that some view has shown.
#[derive(Debug)]
pub(crate) struct Seen {
    /// Their indices, ascending.
    pub(crate) indices: Vec<u32>,
    places: Buffer,
    num_all: u32,
}

impl Work<'_> {
    /// Who is seen in what was drawn of a scene.
    ///
    /// # Errors
    /// Where the GPU has not so much room, or has stopped.
    pub(crate) fn seen(&mut self, scene: &SceneBuffers) -> Result<Seen, GpuError> {
        let num_all = to_u32(scene.len);
        let places = self.buffer::<u32>("places of the seen", scene.len + 1)?;
        let size = self.tell(&[num_all, 0, 0, 0]);
        self.run(&FLAG_SEEN, &[&size], &[(1, &scene.gradients), (2, &places)], groups_over(num_all + 1));
        scan(self, &places, num_all + 1)?;
        let count = self.read::<u32>(&places, scene.len, 1)?[0] as usize;
        let indices = self.buffer::<u32>("seen", count)?;
        self.run(&LIST_SEEN, &[&size], &[(2, &places), (4, &indices)], groups_over(num_all));
        Ok(Seen { indices: self.read(&indices, 0, count)?, places, num_all })
    }

    /// Some numbers of the rows of those that are seen, one Gaussian after the other.
    ///
    /// # Errors
    /// As [`Work::seen`].
    pub(crate) fn gather(&mut self, seen: &Seen, rows: &Buffer, columns: Range<usize>) -> Result<Vec<f32>, GpuError> {
        let all = seen.indices.len() * columns.len();
        let packed = self.buffer::<f32>("packed rows", all)?;
        let size = self.tell(&[seen.num_all, to_u32(columns.start), to_u32(columns.len()), 0]);
        let bindings = [(1, rows), (2, &seen.places), (3, &packed)];
        self.run(&PACK_ROWS, &[&size], &bindings, groups_over(seen.num_all));
        self.read(&packed, 0, all)
    }
}
