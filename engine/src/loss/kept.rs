//! Images that stay on a GPU as long as a refinement looks at them: the true ones, and those that were drawn before a step.

use std::marker::PhantomData;

#[cfg(feature = "gpu")]
use crate::render::gpu::{GpuError, Owned, Work};
use crate::views::View;

/// Bytes of a pixel of a drawn image.
#[cfg(feature = "gpu")]
const BYTES_OF_PIXEL: usize = size_of::<[f32; 4]>();

/// The images of views that are borrowed meanwhile, and so stay as they are.
#[derive(Debug, Default)]
pub struct Kept<'v> {
    #[cfg(feature = "gpu")]
    truths: Vec<(&'v View, Owned)>,
    #[cfg(feature = "gpu")]
    drawn: Vec<Owned>,
    /// Whether drawn images stay where they were drawn.
    #[cfg(feature = "gpu")]
    keeps_drawn: bool,
    views: PhantomData<&'v View>,
}

impl Kept<'_> {
    /// With the images that are drawn, where they are wanted and there is room for them: they are then not read.
    pub(crate) fn with_drawn() -> Self {
        Self {
            #[cfg(feature = "gpu")]
            keeps_drawn: true,
            ..Self::default()
        }
    }
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

    /// Makes room for the images of views that are drawn now; whether they stay.
    pub(crate) fn begin_drawn(&mut self, work: &mut Work<'_>, views: &[&View]) -> bool {
        self.drawn.clear();
        let pixels: usize = views.iter().map(|view| view.pinhole.num_pixels()).sum();
        let taken: u64 = self.truths.iter().map(|(_, owned)| owned.buffer().size()).sum();
        if !self.keeps_drawn || taken + (pixels * BYTES_OF_PIXEL) as u64 > work.most_kept() {
            return false;
        }
        let all: Result<Vec<Owned>, GpuError> =
            views.iter().map(|view| work.room_for::<[f32; 4]>("kept image", view.pinhole.num_pixels())).collect();
        self.drawn = all.unwrap_or_default();
        self.drawn.len() == views.len()
    }

    /// Where the image of the view of a number stays, `[H, W, 4]`; `None` where it was read.
    pub(crate) fn drawn(&self, work: &Work<'_>, number: usize) -> Option<wgpu::Buffer> {
        self.drawn.get(number).filter(|owned| work.has(owned)).map(|owned| owned.buffer().clone())
    }
}
