//! Views and rendered images made of pictures.

use lgs_engine::evaluate::lpips::Lpips;
use lgs_engine::evaluate::{ViewFigures, evaluate_view};
use lgs_engine::render::Rendered;
use lgs_engine::views::{PinholeView, Role, View};
use lgs_formats::image::RgbImage;

/// A picture of values `[H, W, 3]`.
#[expect(clippy::cast_possible_truncation, reason = "the values were f32 or bytes")]
pub fn picture(width: usize, height: usize, values: &[f64]) -> RgbImage {
    RgbImage { width, height, data: values.iter().map(|&v| v as f32).collect() }
}

/// The figures of a rendered picture against the true one.
///
/// # Errors
/// Those of [`evaluate_view`].
pub fn measured(
    rendered: &RgbImage,
    truth: &RgbImage,
    dynamic: Option<&[bool]>,
    lpips: Option<&Lpips>,
) -> lgs_engine::error::Result<ViewFigures> {
    evaluate_view(&opaque(rendered), &view_of(truth), dynamic, lpips)
}

/// A picture as if it had been rendered without gaps, at depth 1.
fn opaque(picture: &RgbImage) -> Rendered {
    let plane = vec![1.0; picture.width * picture.height];
    Rendered {
        width: picture.width,
        height: picture.height,
        rgb: picture.data.clone(),
        alpha: plane.clone(),
        depth: plane,
    }
}

/// A view that saw a picture, without labels and without LiDAR.
fn view_of(picture: &RgbImage) -> View {
    let (width, height) = (picture.width, picture.height);
    let pinhole = PinholeView {
        width,
        height,
        fx: 100.0,
        fy: 100.0,
        cx: 0.5 * width as f32,
        cy: 0.5 * height as f32,
        camera_from_clip: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        time: 0.0,
        shutter: None,
        pixel_side: 1.0,
    };
    View {
        frame: 0,
        camera: "camera".to_owned(),
        role: Role::HeldOut,
        pinhole,
        image: picture.clone(),
        labels: None,
        response: None,
        depth_map: None,
        depth_samples: Vec::new(),
    }
}
