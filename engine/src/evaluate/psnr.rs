//! Peak signal-to-noise ratio.

/// PSNR in decibels of two images with values in 0..=1; infinite when they are identical.
///
/// # Shapes
/// `[H, W, 3]` each, or any other number of values, but at least one; none at all gives NaN.
///
/// # Formula
/// `10 log10(1 / mean((a - b)^2))`, the mean over all values, in f64.
pub fn psnr(a: &[f32], b: &[f32]) -> f64 {
    decibels(squared_error(a, b) / a.len() as f64)
}

/// PSNR over the pixels for which `keep` (by row-major index) holds; `None` when there is none.
///
/// # Shapes
/// `a` and `b` `[H, W, 3]`.
///
/// # Formula
/// As [`psnr`]; the squared error is divided by the kept pixels times three.
pub(crate) fn psnr_where(a: &[f32], b: &[f32], keep: impl Fn(usize) -> bool) -> Option<f64> {
    let (mut sum, mut count) = (0.0_f64, 0_usize);
    let pixels = a.chunks_exact(3).zip(b.chunks_exact(3)).enumerate();
    for (_, (a, b)) in pixels.filter(|(i, _)| keep(*i)) {
        sum += squared_error(a, b);
        count += 3;
    }
    (count > 0).then(|| decibels(sum / count as f64))
}

fn squared_error(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum()
}

fn decibels(mean_squared_error: f64) -> f64 {
    -10.0 * mean_squared_error.log10()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tenth_of_error_is_twenty_decibels() {
        assert!((psnr(&[0.5; 12], &[0.4; 12]) - 20.0).abs() < 1e-5);
        assert!((psnr(&[1.0; 3], &[0.0; 3]) - 0.0).abs() < 1e-12);
    }

    #[test]
    fn identical_images_are_infinitely_good() {
        assert_eq!(psnr(&[0.3; 6], &[0.3; 6]), f64::INFINITY);
        assert_eq!(psnr_where(&[0.3; 6], &[0.3; 6], |_| true), Some(f64::INFINITY));
    }

    #[test]
    fn a_mask_divides_by_its_own_pixels() {
        let (a, mut b) = ([0.5_f32; 12], [0.5_f32; 12]);
        b[3..6].fill(0.25);
        b[9..12].fill(1.0);
        assert_eq!(psnr_where(&a, &b, |i| i < 2), Some(-10.0 * (0.0625_f64 / 2.0).log10()));
        assert_eq!(psnr_where(&a, &b, |i| i == 1), Some(-10.0 * 0.0625_f64.log10()));
        assert_eq!(psnr_where(&a, &b, |i| i == 0), Some(f64::INFINITY));
        assert_eq!(psnr_where(&a, &b, |_| true), Some(psnr(&a, &b)));
        assert_eq!(psnr_where(&a, &b, |_| false), None);
    }

    #[test]
    fn what_is_not_finite_shows() {
        assert!(psnr(&[f32::NAN, 0.0], &[0.0, 0.0]).is_nan());
    }
}
