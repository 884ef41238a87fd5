//! A pinhole camera at one moment: clip frame to pixels and back.

use super::shutter::Shutter;

/// A pinhole camera at one moment, in f32 and the clip frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PinholeView {
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
    /// Focal length along x, pixels.
    pub fx: f32,
    /// Focal length along y, pixels.
    pub fy: f32,
    /// Principal point x, pixels (centre of a pixel at +0.5).
    pub cx: f32,
    /// Principal point y, pixels.
    pub cy: f32,
    /// Rows of `camera_from_clip`, rotation and translation (metres).
    pub camera_from_clip: [[f32; 4]; 3],
    /// Moment to render, seconds since the clip's time zero.
    pub time: f32,
    /// How pixels are exposed at moments around that one; `None` where all are at once.
    pub shutter: Option<Shutter>,
    /// Side of what a pixel sees, in distances between pixels: 1, and less where only some of an image's pixels are drawn.
    pub pixel_side: f32,
}

/// Points at this depth or nearer are behind the camera, metres (the renderer's near plane).
pub const NEAR: f32 = 0.01;

/// Where a point of the clip frame is in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projected {
    /// Column, pixels: inside the image, centre of the first at 0.5.
    pub u: f32,
    /// Row, pixels.
    pub v: f32,
    /// Depth along the camera's z axis, metres.
    pub depth: f32,
}

impl PinholeView {
    /// Number of pixels.
    pub const fn num_pixels(&self) -> usize {
        self.width * self.height
    }

    /// How fine the image is: half octaves of its focal length. Cameras that differ by less resolve alike.
    #[expect(clippy::cast_possible_truncation, reason = "a focal length of f32 has some 500 half octaves")]
    pub(crate) fn resolution(&self) -> i32 {
        (2.0 * self.fx.log2()).round() as i32
    }

    /// A point of the clip frame in the camera's axes at the view's time, metres.
    pub fn to_camera(&self, point: [f32; 3]) -> [f32; 3] {
        self.camera_from_clip.map(|row| row[0] * point[0] + row[1] * point[1] + row[2] * point[2] + row[3])
    }

    /// Where a standing point of the clip frame is in the image; `None` when it is outside, or not in front of the camera.
    pub fn project(&self, point: [f32; 3]) -> Option<Projected> {
        self.project_moving(point, [0.0; 3])
    }

    /// As [`PinholeView::project`], of a point that is there at the view's time and moves with a velocity, metres a second.
    pub fn project_moving(&self, point: [f32; 3], velocity: [f32; 3]) -> Option<Projected> {
        let [x, y, depth] = match &self.shutter {
            Some(shutter) => self.when_exposed(shutter, point, velocity),
            None => self.to_camera(point),
        };
        if depth.is_nan() || depth <= NEAR {
            return None;
        }
        let (u, v) = (self.fx * x / depth + self.cx, self.fy * y / depth + self.cy);
        let inside = u >= 0.0 && v >= 0.0 && u < self.width as f32 && v < self.height as f32;
        inside.then_some(Projected { u, v, depth })
    }

    /// The point of the clip frame at `depth` behind image position (`u`, `v`), metres, at the moment at which that is exposed.
    pub(crate) fn unproject(&self, at: Projected) -> [f32; 3] {
        let ray = [(at.u - self.cx) / self.fx, (at.v - self.cy) / self.fy, 1.0];
        let in_camera = match &self.shutter {
            Some(shutter) => shutter.carried_back([at.u, at.v], ray.map(|x| x * at.depth)),
            None => ray.map(|x| x * at.depth),
        };
        let m = &self.camera_from_clip;
        let in_camera: [f32; 3] = std::array::from_fn(|r| in_camera[r] - m[r][3]);
        std::array::from_fn(|c| (0..3).map(|r| m[r][c] * in_camera[r]).sum())
    }

    /// Where the camera stands in the clip frame at the view's time, metres.
    pub fn centre(&self) -> [f32; 3] {
        let m = &self.camera_from_clip;
        std::array::from_fn(|c| -(0..3).map(|r| m[r][c] * m[r][3]).sum::<f32>())
    }
}

impl Projected {
    /// Row-major index of the pixel that it falls into.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "inside the image, so neither negative nor beyond its width and height"
    )]
    pub fn pixel(&self, width: usize) -> usize {
        self.v as usize * width + self.u as usize
    }
}
