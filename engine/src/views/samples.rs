//! Cameras and views for unit tests.

use lgs_formats::image::RgbImage;

use super::{PinholeView, Role, View};

/// A camera at the clip frame's origin that looks along z, its principal point in the middle, at time zero.
pub(crate) fn ahead(width: usize, height: usize, focal: f32) -> PinholeView {
    PinholeView {
        width,
        height,
        fx: focal,
        fy: focal,
        cx: 0.5 * width as f32,
        cy: 0.5 * height as f32,
        camera_from_clip: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        time: 0.0,
        shutter: None,
        pixel_side: 1.0,
    }
}

/// An input view of frame 0 with these colours `[H, W, 3]` and nothing else.
pub(crate) fn seen(pinhole: PinholeView, data: Vec<f32>) -> View {
    View {
        frame: 0,
        camera: "front".to_owned(),
        role: Role::Input,
        response: None,
        image: RgbImage { width: pinhole.width, height: pinhole.height, data },
        pinhole,
        labels: None,
        depth_map: None,
        depth_samples: Vec::new(),
    }
}
