//! What a view would be worth without a reconstruction: the nearest input image in its place.

use lgs_formats::image::PixelLabel;

use super::psnr::psnr_where;
use crate::views::{Role, View};

/// PSNR (decibels) of the nearest input image of the same camera in place of a held-out view's render: nearest by frame, the
/// earlier one where two are as near. Pixels that the view's own labels ignore do not count.
///
/// `None` for an input view, whose nearest input image is itself, and where no image of `inputs` is of the camera and has the
/// view's size.
pub fn copying<'a>(view: &View, inputs: impl IntoIterator<Item = &'a View>) -> Option<f64> {
    if view.role == Role::Input {
        return None;
    }
    let size = |view: &View| (view.image.width, view.image.height);
    let same = inputs.into_iter().filter(|input| input.camera == view.camera && size(input) == size(view));
    let nearest = same.min_by_key(|input| (input.frame.abs_diff(view.frame), input.frame))?;
    let labels = view.labels.as_deref();
    let counts = |pixel: usize| labels.is_none_or(|labels| labels[pixel] != PixelLabel::Ignored);
    psnr_where(&view.as_taken().image.data, &nearest.as_taken().image.data, counts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::views::samples::{ahead, seen};

    /// Two pixels of one grey.
    fn grey(frame: usize, value: f32) -> View {
        View { frame, ..seen(ahead(2, 1, 1.0), vec![value; 6]) }
    }

    fn held_out(frame: usize, value: f32) -> View {
        View { role: Role::HeldOut, ..grey(frame, value) }
    }

    fn decibels(difference: f64) -> f64 {
        -20.0 * difference.log10()
    }

    fn expect(got: Option<f64>, want: f64) {
        assert!(got.is_some_and(|got| (got - want).abs() < 1e-4), "got {got:?}, want {want}");
    }

    #[test]
    fn the_nearest_frame_counts_and_the_earlier_of_two() {
        let inputs = [grey(6, 0.5), grey(4, 0.25), grey(0, 1.0)];
        expect(copying(&held_out(5, 0.0), &inputs), decibels(0.25));
        expect(copying(&held_out(9, 0.0), &inputs), decibels(0.5));
        assert_eq!(copying(&held_out(1, 1.0), &inputs), Some(f64::INFINITY));
    }

    #[test]
    fn other_cameras_other_sizes_and_inputs_have_no_copy() {
        let elsewhere = View { camera: "rear".to_owned(), ..grey(0, 0.5) };
        let larger = seen(ahead(3, 1, 1.0), vec![0.5; 9]);
        assert_eq!(copying(&held_out(1, 0.5), &[elsewhere, larger]), None);
        assert_eq!(copying(&grey(1, 0.5), &[grey(0, 0.5)]), None);
        assert_eq!(copying(&held_out(1, 0.5), &[]), None);
    }

    #[test]
    fn ignored_pixels_do_not_count() {
        let mut view = held_out(1, 0.5);
        view.image.data[3..].fill(1.0);
        view.labels = Some(vec![PixelLabel::Static, PixelLabel::Ignored]);
        expect(copying(&view, &[grey(0, 0.4)]), decibels(0.1));
        view.labels = Some(vec![PixelLabel::Ignored; 2]);
        assert_eq!(copying(&view, &[grey(0, 0.4)]), None);
    }
}
