//! Error of the rendered depth.

use lgs_formats::image::PixelLabel;

use crate::{loss::depth_errors, render::Rendered, views::DepthSample};

/// Mean `|expected depth - LiDAR|` in metres over the samples whose pixel is not ignored; `None` when there is none.
///
/// An uncovered pixel has expected depth 0 and counts with its whole LiDAR depth.
///
/// # Shapes
/// `labels` `[H, W]`.
pub fn dmae(rendered: &Rendered, samples: &[DepthSample], labels: Option<&[PixelLabel]>) -> Option<f64> {
    let (mut sum, mut count) = (0.0_f64, 0_usize);
    for (_, error) in depth_errors(rendered, samples, labels) {
        sum += f64::from(error.abs());
        count += 1;
    }
    (count > 0).then(|| sum / count as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_over_the_samples_that_are_not_ignored() {
        let depth = vec![4.0, 9.0, 0.0];
        let rendered = Rendered { width: 3, height: 1, rgb: vec![0.0; 9], alpha: vec![0.5, 1.0, 0.0], depth };
        let samples = [(0, 10.0), (1, 8.0), (2, 6.0)].map(|(pixel, depth)| DepthSample { pixel, depth });
        assert_eq!(dmae(&rendered, &samples, None), Some(3.0));
        let labels = [PixelLabel::Static, PixelLabel::Dynamic, PixelLabel::Ignored];
        assert_eq!(dmae(&rendered, &samples, Some(&labels)), Some(1.5));
        assert_eq!(dmae(&rendered, &samples, Some(&[PixelLabel::Ignored; 3])), None);
        assert_eq!(dmae(&rendered, &[], None), None);
    }
}
