//! Structural similarity as a figure; the definition is that of the loss, [`crate::loss::ssim`].

use crate::loss::ssim::{ImagePair, similarity_map};

/// Mean SSIM of two images over all window centres ("cropped") and channels; `None` for a side below 11 pixels.
///
/// # Shapes
/// `a` and `b` `[H, W, 3]`, values in 0..=1.
pub fn ssim(a: &[f32], b: &[f32], width: usize, height: usize) -> Option<f64> {
    similarity_map(&ImagePair { truth: a, rendered: b, width, height })?.mean_where(|_| true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flat_images_have_the_similarity_of_their_means() {
        let (a, b) = (vec![0.5; 13 * 12 * 3], vec![0.25; 13 * 12 * 3]);
        let want = (2.0 * 0.5 * 0.25 + 1e-4) / (0.25 + 0.0625 + 1e-4);
        assert!((ssim(&a, &b, 13, 12).unwrap() - want).abs() < 1e-6);
        assert_eq!(ssim(&a, &a, 13, 12), Some(1.0));
    }

    #[test]
    fn it_does_not_matter_which_image_is_the_truth() {
        let a: Vec<f32> = (0..15 * 14 * 3).map(|i| ((i * 37) % 101) as f32 / 101.0).collect();
        let b: Vec<f32> = (0..15 * 14 * 3).map(|i| ((i * 53) % 97) as f32 / 97.0).collect();
        assert!((ssim(&a, &b, 15, 14).unwrap() - ssim(&b, &a, 15, 14).unwrap()).abs() < 1e-6);
    }

    #[test]
    fn an_image_smaller_than_the_window_has_none() {
        assert_eq!(ssim(&[0.5; 300], &[0.5; 300], 10, 10), None);
    }
}
