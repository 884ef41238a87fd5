//! From one camera's pixels and depths to another one's pixels.

use super::evidence::middle;
use crate::views::{NEAR, PinholeView, Projected};

/// `source_from_view` of two cameras.
#[derive(Clone, Copy, Debug)]
pub(super) struct RelativePose {
    rotation: [[f32; 3]; 3],
    /// Metres, in the source's axes.
    pub(super) translation: [f32; 3],
}

impl RelativePose {
    /// The pose of the camera of `view` in the axes of that of `source`.
    pub(super) fn new(view: &PinholeView, source: &PinholeView) -> Self {
        let (a, b) = (&view.camera_from_clip, &source.camera_from_clip);
        let rotation: [[f32; 3]; 3] =
            std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| b[i][k] * a[j][k]).sum()));
        let translation = std::array::from_fn(|i| b[i][3] - (0..3).map(|k| rotation[i][k] * a[k][3]).sum::<f32>());
        Self { rotation, translation }
    }

    /// The pose at the moment at which a pixel of `view` is exposed; this one, which is at its time, where all are at once.
    pub(super) fn of_pixel(&self, view: &PinholeView, pixel: usize, source: &PinholeView) -> Self {
        if view.shutter.is_none() {
            return *self;
        }
        let at = middle(pixel, view.width);
        Self::new(&view.exposing([at.u, at.v]), source)
    }

    /// The ray of a pixel in the source's axes: `start + w * self.translation` is the point at inverse depth w, times w.
    pub(super) fn start(&self, view: &PinholeView, pixel: usize) -> [f32; 3] {
        let at = middle(pixel, view.width);
        let ray = [(at.u - view.cx) / view.fx, (at.v - view.cy) / view.fy, 1.0];
        self.rotation.map(|row| row[0] * ray[0] + row[1] * ray[1] + row[2] * ray[2])
    }

    /// Where the point of `view` at inverse depth `inverse` behind `pixel` is in `source`; its `depth` is the source's.
    pub(super) fn transfer(
        &self,
        view: &PinholeView,
        pixel: usize,
        inverse: f32,
        source: &PinholeView,
    ) -> Option<Projected> {
        let pose = self.of_pixel(view, pixel, source);
        let at = project(pose.start(view, pixel), pose.translation, inverse, source)?;
        Some(Projected { depth: at.depth / inverse.max(f32::MIN_POSITIVE), ..at })
    }
}

/// The image position of `start + inverse * shift`; its `depth` is that times the inverse depth.
fn project(start: [f32; 3], shift: [f32; 3], inverse: f32, source: &PinholeView) -> Option<Projected> {
    let point: [f32; 3] = std::array::from_fn(|k| start[k] + inverse * shift[k]);
    let moved = source.shutter.map_or([0.0; 3], |shutter| shutter.shift(&source.lens(), point, inverse));
    seen(std::array::from_fn(|k| point[k] + moved[k]), source)
}

/// The image position of a point in the camera's axes.
fn seen([x, y, z]: [f32; 3], source: &PinholeView) -> Option<Projected> {
    let (u, v) = (source.fx * x / z + source.cx, source.fy * y / z + source.cy);
    let inside = z > NEAR && u >= 0.0 && v >= 0.0 && u < source.width as f32 && v < source.height as f32;
    inside.then_some(Projected { u, v, depth: z })
}
