//! Made-up scenes for the renderer, in f64 values that f32 holds exactly.

use std::ops::Range;

use lgs_engine::gaussians::physical::{Splat, SplatGradient};
use lgs_engine::render::reference::{Camera, Gaussian, Gradient, Images};
use lgs_engine::render::{ImageGradient, Rendered};
use lgs_engine::views::PinholeView;

use crate::random::Random;

/// Gaussians and a camera that sees them.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The Gaussians.
    pub gaussians: Vec<Gaussian>,
    /// The camera.
    pub camera: Camera,
}

/// What a random scene looks like.
#[derive(Clone, Copy, Debug)]
pub struct Look {
    /// Number of Gaussians.
    pub num: usize,
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
    /// Smallest and largest opacity.
    pub opacities: [f64; 2],
}

/// A random scene: Gaussians of a few pixels, some of them outside the image and some moving, 2 to 12 m in front of a
/// camera that is turned and shifted a little.
pub fn random_scene(look: Look, seed: u64) -> Scene {
    let mut random = Random::new(seed);
    let camera = random_camera(look, &mut random);
    let gaussians = (0..look.num).map(|_| random_gaussian(&camera, look.opacities, &mut random)).collect();
    Scene { gaussians, camera }
}

fn random_camera(look: Look, random: &mut Random) -> Camera {
    let (width, height) = (look.width as f64, look.height as f64);
    let rotation = rotation_of([1.0, 0.1, 0.1, 0.1].map(|size| size * random.uniform(0.5, 1.0)));
    let shift: [f64; 3] = random.uniforms(-1.0, 1.0);
    let row = |r: usize| [rotation[r][0], rotation[r][1], rotation[r][2], shift[r]].map(single);
    Camera {
        width: look.width,
        height: look.height,
        fx: single(random.uniform(0.8, 1.2) * width),
        fy: single(random.uniform(0.8, 1.2) * width),
        cx: single(random.uniform(0.45, 0.55) * width),
        cy: single(random.uniform(0.45, 0.55) * height),
        camera_from_world: std::array::from_fn(row),
        time: 0.25,
    }
}

fn random_gaussian(camera: &Camera, opacities: [f64; 2], random: &mut Random) -> Gaussian {
    let z = random.uniform(2.0, 12.0);
    let u = random.uniform(-0.2, 1.2) * camera.width as f64;
    let v = random.uniform(-0.2, 1.2) * camera.height as f64;
    let sizes_px = random.uniforms(0.3, 4.0);
    let opacity = random.uniform(opacities[0], opacities[1]);
    Gaussian { opacity, ..from_pixels(camera, [u, v], z, sizes_px, random) }
}

/// A Gaussian that stands at a pixel and a depth, with standard deviations of so many pixels; what is left is random.
pub fn from_pixels(camera: &Camera, pixel: [f64; 2], z: f64, sizes_px: [f64; 3], random: &mut Random) -> Gaussian {
    let seen = [(pixel[0] - camera.cx) / camera.fx * z, (pixel[1] - camera.cy) / camera.fy * z, z];
    let rows = &camera.camera_from_world;
    let relative: [f64; 3] = std::array::from_fn(|k| seen[k] - rows[k][3]);
    let world: [f64; 3] = std::array::from_fn(|c| (0..3).map(|r| rows[r][c] * relative[r]).sum());
    Gaussian {
        mean: world.map(single),
        quat: random.uniforms(-1.0, 1.0),
        scale: sizes_px.map(|px| single(px * z / camera.fx)),
        opacity: random.uniform(0.05, 1.0),
        colour: random.uniforms(0.0, 1.0),
        velocity: random.uniforms(-0.5, 0.5),
        time: random.uniform(0.0, 0.5),
    }
}

/// Rotation matrix of a quaternion (w, x, y, z) of any length.
pub fn rotation_of(quat: [f64; 4]) -> [[f64; 3]; 3] {
    let norm = quat.iter().map(|q| q * q).sum::<f64>().sqrt();
    let [w, x, y, z] = quat.map(|q| q / norm);
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// Random weights of all four images, zero at the pixels that `skip` marks.
pub fn random_weights(camera: &Camera, skip: &[bool], seed: u64) -> Images {
    let mut random = Random::new(seed);
    let mut weights = Images::zeros(camera.width * camera.height);
    for pixel in (0..skip.len()).filter(|&p| !skip[p]) {
        weights.rgb[3 * pixel..][..3].copy_from_slice(&random.uniforms::<3>(-1.0, 1.0));
        weights.alpha[pixel] = random.uniform(-1.0, 1.0);
        weights.depth[pixel] = random.uniform(-0.1, 0.1);
        weights.expected_depth[pixel] = random.uniform(-0.1, 0.1);
    }
    weights
}

/// `sum weights . images`: a scalar whose gradient by the images is `weights`.
pub fn weighted_sum(images: &Images, weights: &Images) -> f64 {
    let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    sum(&images.rgb, &weights.rgb)
        + sum(&images.alpha, &weights.alpha)
        + sum(&images.depth, &weights.depth)
        + sum(&images.expected_depth, &weights.expected_depth)
}

fn single(value: f64) -> f64 {
    f64::from(narrow(value))
}

#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is the point")]
fn narrow(value: f64) -> f32 {
    value as f32
}

fn narrow_all(values: &[f64]) -> Vec<f32> {
    values.iter().map(|&v| narrow(v)).collect()
}

fn widen_all(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&v| f64::from(v)).collect()
}

/// The Gaussians as the fast path takes them.
pub fn splats(gaussians: &[Gaussian]) -> Vec<Splat> {
    let splat = |g: &Gaussian| Splat {
        mean: g.mean.map(narrow),
        quat: g.quat.map(narrow),
        scale: g.scale.map(narrow),
        opacity: narrow(g.opacity),
        colour: g.colour.map(narrow),
        velocity: g.velocity.map(narrow),
        time: narrow(g.time),
    };
    gaussians.iter().map(splat).collect()
}

/// The camera as the fast path takes it.
pub fn pinhole(camera: &Camera) -> PinholeView {
    PinholeView {
        width: camera.width,
        height: camera.height,
        fx: narrow(camera.fx),
        fy: narrow(camera.fy),
        cx: narrow(camera.cx),
        cy: narrow(camera.cy),
        camera_from_clip: camera.camera_from_world.map(|row| row.map(narrow)),
        time: narrow(camera.time),
        shutter: None,
        pixel_side: 1.0,
    }
}

/// The fast path's images in f64.
pub fn images_of(rendered: &Rendered) -> Images {
    Images {
        rgb: widen_all(&rendered.rgb),
        alpha: widen_all(&rendered.alpha),
        depth: widen_all(&rendered.depth),
        expected_depth: widen_all(&rendered.expected_depth()),
    }
}

/// Image gradients as the fast path takes them.
pub fn image_gradient(weights: &Images) -> ImageGradient {
    ImageGradient {
        rgb: narrow_all(&weights.rgb),
        alpha: narrow_all(&weights.alpha),
        depth: narrow_all(&weights.depth),
        expected_depth: narrow_all(&weights.expected_depth),
    }
}

/// The fast path's gradients in f64.
pub fn gradients_of(gradients: &[SplatGradient]) -> Vec<Gradient> {
    let gradient = |g: &SplatGradient| Gradient {
        mean: g.mean.map(f64::from),
        quat: g.quat.map(f64::from),
        scale: g.scale.map(f64::from),
        opacity: f64::from(g.opacity),
        colour: g.colour.map(f64::from),
        velocity: g.velocity.map(f64::from),
    };
    gradients.iter().map(gradient).collect()
}

/// The parts of a flattened gradient.
pub const GRADIENT_PARTS: [(&str, Range<usize>); 6] =
    [("mean", 0..3), ("quat", 3..7), ("scale", 7..10), ("opacity", 10..11), ("colour", 11..14), ("velocity", 14..17)];

/// The 17 numbers of one gradient, in the order of [`GRADIENT_PARTS`].
pub fn flat_gradient(g: &Gradient) -> [f64; 17] {
    let mut out = [0.0; 17];
    out[..3].copy_from_slice(&g.mean);
    out[3..7].copy_from_slice(&g.quat);
    out[7..10].copy_from_slice(&g.scale);
    out[10] = g.opacity;
    out[11..14].copy_from_slice(&g.colour);
    out[14..].copy_from_slice(&g.velocity);
    out
}
