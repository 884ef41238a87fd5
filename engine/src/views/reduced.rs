//! A view at a lower resolution, for what compares whole images.

use super::{PinholeView, View};

/// Image and camera of a view, reduced by a whole factor.
#[derive(Clone, Debug)]
pub(crate) struct Reduced {
    /// The camera at this resolution.
    pub(crate) pinhole: PinholeView,
    /// `[H, W]` mean colours of the blocks, 0..=255.
    pub(crate) colours: Vec<[u8; 3]>,
}

impl Reduced {
    /// `view` reduced by `factor`; rows and columns at the end that do not fill a block are left out.
    pub(crate) fn new(view: &View, factor: usize) -> Self {
        let pinhole = view.pinhole.reduced(factor);
        let pixels = 0..pinhole.num_pixels();
        let colours = pixels.map(|i| block_mean(view, i / pinhole.width, i % pinhole.width, factor)).collect();
        Self { pinhole, colours }
    }

    /// Mean absolute difference of two pixels' channels, grey levels.
    pub(crate) fn difference(&self, pixel: usize, other: usize) -> f32 {
        difference(self.colours[pixel], self.colours[other])
    }
}

fn block_mean(view: &View, row: usize, column: usize, factor: usize) -> [u8; 3] {
    view.mean_colour(view.pinhole.block(row, column, factor)).map(to_byte)
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the range of a byte")]
fn to_byte(value: f32) -> u8 {
    (value * 255.0).round().clamp(0.0, 255.0) as u8
}

/// Mean absolute difference of two colours' channels, grey levels.
pub(crate) fn difference(a: [u8; 3], b: [u8; 3]) -> f32 {
    let sum: u16 = a.iter().zip(b).map(|(&x, y)| u16::from(x.abs_diff(y))).sum();
    f32::from(sum) / 3.0
}
