//! Error of the expected depth against LiDAR.

use lgs_formats::image::PixelLabel;

use crate::{render::Rendered, views::DepthSample};

/// Mean `|expected depth - LiDAR|` (metres) over the samples whose pixel is not ignored, with `weight` times its gradient
/// by the expected depth; without a sample 0, and an empty gradient that stands for zeros.
///
/// # Shapes
/// `labels` `[H, W]`; gradient `[H, W]` or empty.
///
/// # Formula
/// Expected depth is `depth / max(alpha, 1e-10)`: 0 where nothing was drawn, so an uncovered pixel counts with its whole
/// LiDAR depth. A rendered depth that is not finite makes the mean not finite.
///
/// # Gradient
/// `weight sign(expected - LiDAR) / samples`, 0 where both are equal.
pub(super) fn depth_loss(
    rendered: &Rendered,
    samples: &[DepthSample],
    labels: Option<&[PixelLabel]>,
    weight: f32,
) -> (f64, Vec<f32>) {
    let count = depth_errors(rendered, samples, labels).count();
    if count == 0 {
        return (0.0, Vec::new());
    }
    let slope = weight / count as f32;
    let mut gradient = vec![0.0; rendered.depth.len()];
    let mut sum = 0.0_f64;
    for (pixel, error) in depth_errors(rendered, samples, labels) {
        sum += f64::from(error.abs());
        gradient[pixel] += if error == 0.0 { 0.0 } else { slope.copysign(error) };
    }
    (sum / count as f64, gradient)
}

/// Pixel and expected depth minus LiDAR depth (metres) of each sample whose pixel is not ignored.
pub(crate) fn depth_errors(
    rendered: &Rendered,
    samples: &[DepthSample],
    labels: Option<&[PixelLabel]>,
) -> impl Iterator<Item = (usize, f32)> {
    let pixels = samples.iter().map(|sample| (sample.pixel as usize, sample.depth));
    pixels
        .filter(move |&(pixel, _)| labels.is_none_or(|labels| labels[pixel] != PixelLabel::Ignored))
        .map(|(pixel, depth)| (pixel, rendered.depth[pixel] / rendered.alpha[pixel].max(1e-10) - depth))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rendered(depth: &[f32], alpha: &[f32]) -> Rendered {
        let (width, height) = (depth.len(), 1);
        Rendered { width, height, rgb: vec![0.0; 3 * width], alpha: alpha.to_vec(), depth: depth.to_vec() }
    }

    fn sample(pixel: u32, depth: f32) -> DepthSample {
        DepthSample { pixel, depth }
    }

    #[test]
    fn value_is_the_mean_over_samples() {
        let image = rendered(&[4.0, 9.0, 0.0, 7.0], &[0.5, 1.0, 0.0, 1.0]);
        let (value, gradient) = depth_loss(&image, &[sample(0, 10.0), sample(1, 8.0), sample(2, 6.0)], None, 3.0);
        assert_eq!(value, (2.0 + 1.0 + 6.0) / 3.0);
        assert_eq!(gradient, [-1.0, 1.0, -1.0, 0.0]);
    }

    #[test]
    fn ignored_pixels_take_no_part() {
        let image = rendered(&[4.0, 9.0], &[1.0, 1.0]);
        let labels = [PixelLabel::Ignored, PixelLabel::Dynamic];
        let (value, gradient) = depth_loss(&image, &[sample(0, 10.0), sample(1, 7.0)], Some(&labels), 1.0);
        assert_eq!(value, 2.0);
        assert_eq!(gradient, [0.0, 1.0]);
    }

    #[test]
    fn no_sample_is_no_loss() {
        let image = rendered(&[4.0], &[1.0]);
        assert_eq!(depth_loss(&image, &[], None, 1.0), (0.0, vec![]));
        assert_eq!(depth_loss(&image, &[sample(0, 1.0)], Some(&[PixelLabel::Ignored]), 1.0), (0.0, vec![]));
    }

    #[test]
    fn gradient_is_the_finite_difference_by_the_expected_depth() {
        let depths = [3.0_f32, 12.5, 7.0, 20.0];
        let samples = [sample(0, 4.0), sample(1, 10.0), sample(3, 19.0)];
        let (_, gradient) = depth_loss(&rendered(&depths, &[1.0; 4]), &samples, None, 0.25);
        for pixel in 0..4 {
            let moved = |by: f32| {
                let mut depths = depths;
                depths[pixel] += by;
                depth_loss(&rendered(&depths, &[1.0; 4]), &samples, None, 0.25).0
            };
            let want = 0.25 * (moved(0.5) - moved(-0.5));
            assert!((f64::from(gradient[pixel]) - want).abs() < 1e-7, "pixel {pixel}: {} {want}", gradient[pixel]);
        }
    }

    #[test]
    fn a_depth_that_is_not_finite_shows_in_the_value() {
        let (value, _) = depth_loss(&rendered(&[f32::NAN], &[1.0]), &[sample(0, 1.0)], None, 1.0);
        assert!(value.is_nan());
    }
}
