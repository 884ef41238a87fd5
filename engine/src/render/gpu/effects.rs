//! What taking out each Gaussian does to what a view costs, as [`effects`](super::super::effects) has it, but for halves.

use wgpu::Buffer;

use super::error::GpuError;
use super::forward::Drawn;
use super::kernels::Kernel;
use super::walk::{WALK, WALK_BACK, Walk};
use super::work::{Work, groups_over};

const TAKE_OUT: Kernel = Kernel::new("take_out", &[WALK, WALK_BACK, include_str!("effects.wgsl")]);
const SUM_EFFECTS: Kernel = Kernel::new("sum_effects", &[include_str!("effects_sum.wgsl")]);

const SUMS_NAME: &str = "effects of intersections";
/// Bytes of an intersection's effects.
const SUMS_BYTES: u64 = size_of::<[f32; 4]>() as u64;

/// What a view costs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ViewCosts<'a> {
    /// `[H, W, 4]` true colours; depth, 0 where there is none, -1 where the pixel is ignored.
    pub(crate) truth: &'a Buffer,
    /// `[H, W, 2, 4]` gradient by the colours of the terms that count as linear, first.
    pub(crate) slopes: &'a Buffer,
    /// What an error of 1 costs: of a colour, of its square, of a depth.
    pub(crate) per: [f32; 3],
}

impl Work<'_> {
    /// Adds what each Gaussian does to the costs of a view, drawn through what is opaque.
    ///
    /// # Shapes
    /// `effects` `[N, 4]`: removal, pixels shown and covered.
    ///
    /// # Errors
    /// Where it does not fit, or the GPU has stopped.
    pub(crate) fn add_effects(
        &mut self,
        drawn: &Drawn,
        ViewCosts { truth, slopes, per }: ViewCosts<'_>,
        effects: &Buffer,
    ) -> Result<(), GpuError> {
        let lists = &drawn.lists;
        let per = [per[0], per[1], per[2], 0.0];
        for batch in self.batches(drawn, SUMS_NAME, SUMS_BYTES)? {
            let sums = self.buffer::<[f32; 4]>(SUMS_NAME, batch.places.len())?;
            let told = self.tell(&Walk { per, ..drawn.walk_back(&batch.tiles, batch.places.start) });
            let bindings = [
                (1, &drawn.footprints),
                (2, &lists.first_of_tile),
                (3, &lists.intersections),
                (4, &drawn.image),
                (5, &drawn.ends),
                (6, truth),
                (7, slopes),
                (8, &sums),
            ];
            self.run(&TAKE_OUT, &[&told], &bindings, batch.tiles.end - batch.tiles.start);
            let told = self.tell(&[batch.places.start, batch.places.end - batch.places.start, drawn.num_visible, 0]);
            let bindings =
                [(1, &lists.visible), (2, &lists.first_of_splat), (3, &lists.places), (4, &sums), (5, effects)];
            self.run(&SUM_EFFECTS, &[&told], &bindings, groups_over(drawn.num_visible));
        }
        Ok(())
    }
}
