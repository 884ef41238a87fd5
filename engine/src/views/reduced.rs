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
        let full = &view.pinhole;
        let share = 1.0 / factor as f32;
        let pinhole = PinholeView {
            width: (full.width / factor).max(1),
            height: (full.height / factor).max(1),
            fx: full.fx * share,
            fy: full.fy * share,
            cx: full.cx * share,
            cy: full.cy * share,
            ..*full
        };
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
    let (width, height) = (view.pinhole.width, view.pinhole.height);
    let (rows, columns) =
        (row * factor..((row + 1) * factor).min(height), column * factor..((column + 1) * factor).min(width));
    let mut sum = [0.0; 3];
    for y in rows.clone() {
        for pixel in y * width + columns.start..y * width + columns.end {
            let colour = &view.image.data[3 * pixel..3 * pixel + 3];
            sum = std::array::from_fn(|k| sum[k] + colour[k]);
        }
    }
    let share = 1.0 / (rows.len() * columns.len()).max(1) as f32;
    sum.map(|s: f32| to_byte(s * share))
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
