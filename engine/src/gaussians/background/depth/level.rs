//! Views as they are matched, and the hypotheses of their pixels.

use crate::{parallel, views::reduced::Reduced};

/// Hypotheses of a pixel.
pub(super) const NUM_LABELS: usize = 128;
/// The hypothesis that the pixel shows the own vehicle, which moves with the camera.
pub(super) const OWN_VEHICLE: usize = NUM_LABELS - 1;
/// The hypotheses `label * step` of the inverse depth; one label between them and the own vehicle is never chosen, so that
/// neighbours do not slide from one to the other.
pub(super) const NUM_DEPTHS: usize = NUM_LABELS - 2;
/// Largest cost of a difference in colour, grey levels.
pub(super) const MAX_DIFFERENCE: f32 = 60.0;

/// A view with the descriptors that are compared.
#[derive(Clone, Debug)]
pub(super) struct Level {
    /// The reduced view.
    pub(super) view: Reduced,
    /// `[H, W]` which neighbours in a 5 x 5 window are darker than the pixel, one bit each.
    pub(super) census: Vec<u32>,
}

impl Level {
    /// The descriptors of a reduced view.
    pub(super) fn new(view: Reduced) -> Self {
        let census = census(&view);
        Self { view, census }
    }
}

fn census(view: &Reduced) -> Vec<u32> {
    /// Neighbours must be darker by this much, summed over the channels, so that noise does not count.
    const MARGIN: u16 = 5;
    let (width, height) = (view.pinhole.width, view.pinhole.height);
    let grey: Vec<u16> = view.colours.iter().map(|c| c.iter().map(|&v| u16::from(v)).sum()).collect();
    let bits_of = |pixel: usize| {
        let (column, row) = (pixel % width, pixel / width);
        let around = |at: usize, k: usize, size: usize| (at + k).saturating_sub(2).min(size - 1);
        (0..25).fold(0, |bits, k| {
            let other = around(row, k / 5, height) * width + around(column, k % 5, width);
            bits << 1 | u32::from(grey[other] + MARGIN < grey[pixel])
        })
    };
    parallel::map(grey.len(), 512, &bits_of)
}
