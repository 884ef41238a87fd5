//! Single Gaussians on the pixels of an image.

use std::ops::Range;

use super::{Ellipse, SURELY_COVERED, Shape};

/// What a Gaussian takes from the pixels of an image.
#[derive(Debug)]
pub(super) struct Drawn {
    /// Its middle, pixels.
    centre: [f32; 2],
    /// Along a row at height y the exponent is `(x - shear y)^2 / narrow + y^2 / yy`.
    shear: f32,
    narrow: f32,
    yy: f32,
    /// Square of its radius, standard deviations.
    reach: f32,
    opacity: f32,
    /// The rows that it reaches.
    rows: Range<usize>,
}

impl Drawn {
    /// `None` for one that is no number, or beside the image, of a width and height.
    pub(super) fn new(
        Ellipse { centre, covariance: [xx, xy, yy] }: Ellipse,
        shape: &Shape,
        size: [usize; 2],
    ) -> Option<Self> {
        let reach = 2.0 * shape.log_opacity;
        let determinant = xx * yy - xy * xy;
        let sound = reach > 0.0 && determinant > 0.0 && determinant.is_finite();
        if !sound || pixels(centre[0], (reach * xx).sqrt(), size[0]).is_empty() {
            return None;
        }
        let rows = pixels(centre[1], (reach * yy).sqrt(), size[1]);
        let (shear, narrow) = (xy / yy, determinant / yy);
        (!rows.is_empty()).then_some(Self { centre, shear, narrow, yy, reach, opacity: shape.opacity, rows })
    }

    /// Adds it to the rows from the `first` one on, of an image of a width.
    pub(super) fn add(&self, band: &mut [f32], first: usize, width: usize) {
        let last = first + band.len() / width;
        for row in self.rows.start.max(first)..self.rows.end.min(last) {
            let y = row as f32 + 0.5 - self.centre[1];
            let (middle, along) = (self.centre[0] + self.shear * y, y * y / self.yy);
            let columns = pixels(middle, ((self.reach - along).max(0.0) * self.narrow).sqrt(), width);
            let line = &mut band[(row - first) * width..(row - first + 1) * width];
            for (column, cell) in columns.clone().zip(&mut line[columns]) {
                let x = column as f32 + 0.5 - middle;
                let q = x * x / self.narrow + along;
                if q < self.reach && *cell > SURELY_COVERED {
                    *cell += (1.0 - (self.opacity * (-0.5 * q).exp()).min(0.999)).ln();
                }
            }
        }
    }
}

/// The pixels, of so many in a row or column, that reach so far around a place.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the image before the cast")]
fn pixels(centre: f32, radius: f32, size: usize) -> Range<usize> {
    let low = (centre - radius - 0.5).ceil().clamp(0.0, size as f32) as usize;
    let high = (centre + radius + 0.5).floor().clamp(0.0, size as f32) as usize;
    low..high
}
