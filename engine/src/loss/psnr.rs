//! Peak signal-to-noise ratio as a term of the loss.

/// Mean squared error below which the ratio counts as reached: 50 dB.
const FLOOR: f64 = 1e-5;

/// Peak signal-to-noise ratio of the colours, decibels; adds `-weight` times its gradient to `gradient`.
///
/// # Shapes
/// All slices `[H, W, 3]`. `num_values` is the number of values that take part; the others must be equal in both images. No value: 0.
///
/// # Formula
/// `-10 log10(mse + 1e-5)`.
///
/// # Gradient
/// Exact. An error that is not finite makes the ratio not finite and the gradient zero.
pub(super) fn add_psnr_gradient(
    rendered: &[f32],
    truth: &[f32],
    num_values: usize,
    weight: f32,
    gradient: &mut [f32],
) -> f64 {
    if num_values == 0 {
        return 0.0;
    }
    let squares = rendered.iter().zip(truth).map(|(r, t)| f64::from(r - t).powi(2));
    let mse = squares.sum::<f64>() / num_values as f64 + FLOOR;
    if mse.is_finite() {
        let slope = f64::from(weight) * 20.0 / std::f64::consts::LN_10 / (mse * num_values as f64);
        let slope = lgs_formats::casts::to_f32(slope);
        let values = gradient.iter_mut().zip(rendered.iter().zip(truth));
        values.for_each(|(g, (r, t))| *g += slope * (r - t));
    }
    -10.0 * mse.log10()
}

#[cfg(test)]
mod tests {
    use super::add_psnr_gradient;

    #[test]
    fn the_gradient_is_that_of_differences() {
        let truth = [0.2_f32, 0.9, 0.4, 0.0, 0.3, 0.6];
        let rendered = [0.25_f32, 0.7, 0.4, 0.1, 0.35, 0.5];
        let mut gradient = [0.0; 6];
        let psnr = add_psnr_gradient(&rendered, &truth, 6, 0.5, &mut gradient);
        assert!((psnr - 10.0 * (6.0_f64 / 0.0650).log10()).abs() < 0.01, "{psnr}");
        for k in 0..6 {
            let at = |by: f32| {
                let mut moved = rendered;
                moved[k] += by;
                add_psnr_gradient(&moved, &truth, 6, 0.5, &mut [0.0; 6])
            };
            let want = -0.5 * (at(1e-3) - at(-1e-3)) / 2e-3;
            assert!((f64::from(gradient[k]) - want).abs() < 1e-3 * want.abs().max(1.0), "{k}: {} {want}", gradient[k]);
        }
    }

    #[test]
    fn equal_images_are_worth_fifty_decibels_and_pull_nowhere() {
        let mut gradient = [0.0; 3];
        assert!((add_psnr_gradient(&[0.5; 3], &[0.5; 3], 3, 1.0, &mut gradient) - 50.0).abs() < 1e-9);
        assert_eq!(gradient, [0.0; 3]);
        assert!(add_psnr_gradient(&[f32::NAN; 3], &[0.5; 3], 3, 1.0, &mut gradient).is_nan());
        assert_eq!(gradient, [0.0; 3]);
    }
}
