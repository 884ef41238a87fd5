//! True images that stay on a GPU as long as a refinement looks at them.

use std::marker::PhantomData;

#[cfg(feature = "gpu")]
use crate::render::gpu::{GpuError, Owned, Work};
use crate::views::View;

/// The true images of views that are borrowed meanwhile, and so stay as they are.
#[derive(Debug, Default)]
pub struct Kept<'v> {
    #[cfg(feature = "gpu")]
    truths: Vec<(&'v View, Owned)>,
    views: PhantomData<&'v View>,
}

#[cfg(feature = "gpu")]
impl<'v> Kept<'v> {
    /// The truth of a view on the GPU, as [`packed`](super::gpu::packed) has it: the one that is there, or what is given to it now, and kept
    /// where there is room for it.
    ///
    /// # Errors
    /// Where the GPU has not so much room.
    pub(super) fn truth(&mut self, work: &mut Work<'_>, view: &'v View) -> Result<wgpu::Buffer, GpuError> {
        let is_here = |(kept, owned): &&(&View, Owned)| std::ptr::eq(*kept, view) && work.has(owned);
        if let Some((_, owned)) = self.truths.iter().find(is_here) {
            return Ok(owned.buffer().clone());
        }
        let pixels = super::gpu::packed(view);
        let taken: u64 = self.truths.iter().map(|(_, owned)| owned.buffer().size()).sum();
        if taken + size_of_val(pixels.as_slice()) as u64 <= work.most_kept()
            && let Ok(owned) = work.own("kept truth", &pixels)
        {
            let buffer = owned.buffer().clone();
            self.truths.push((view, owned));
            return Ok(buffer);
        }
        work.upload("truth", &pixels)
    }
}
