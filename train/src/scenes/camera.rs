//! Images of a moment: colours, exact depth, velocity and labels of every pixel.
//!
//! One ray through each pixel's centre decides depth, velocity and label. Colours inside a surface are the mean of
//! [`SAMPLES`] of its texture on the tangent plane; where a pixel differs from a neighbour in surface or shadow, each
//! sample is a ray of its own.

use glam::{Mat3, Vec3};
use lgs_formats::casts::to_f32;
use lgs_formats::{
    image::{PixelLabel, RgbImage},
    pose::Pose,
};
use rayon::prelude::*;

use super::{
    ground::Zone,
    maths::{narrow_mat, narrow3, sin_cos},
    rig::{CameraSpec, fisheye_angle},
    shapes::Ray,
    sky::Light,
    world::{Hit, Moment, Target},
};

/// Samples of a pixel, as offsets from its corner: no two share a row or a column, which suits upright edges.
const SAMPLES: [(f32, f32); 4] = [(0.375, 0.125), (0.875, 0.375), (0.125, 0.625), (0.625, 0.875)];

/// Width of a sample in pixels.
const SAMPLE_WIDTH: f32 = 0.5;

/// Depth up to which surfaces are drawn (metres).
const FAR: f32 = 2000.0;

/// A rendered image and what is exactly known of its pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// The colours.
    pub rgb: RgbImage,
    /// `[H, W]` camera-space z at pixel centres, metres; infinite in the sky, NaN beside and behind a fisheye.
    pub depth: Vec<f32>,
    /// `[H, W]` velocity of the surface in the clip's world, m/s.
    pub velocity: Vec<[f32; 3]>,
    /// `[H, W]` moving or static.
    pub labels: Vec<PixelLabel>,
}

/// An image plane in the world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ImagePlane {
    pub(crate) width: usize,
    pub(crate) height: usize,
    origin: Vec3,
    world_from_camera: Mat3,
    focal: f32,
    centre: [f32; 2],
    fisheye: Option<[f64; 4]>,
}

/// One line of an image, or all of them: what is exposed at once.
#[derive(Debug)]
pub(crate) struct Exposure<'a> {
    pub(crate) moment: Moment<'a>,
    pub(crate) plane: ImagePlane,
}

/// What is exposed one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Lines {
    /// All pixels at once.
    One,
    /// Rows.
    Rows,
    /// Columns.
    Columns,
}

/// The exposures of an image.
#[derive(Debug)]
pub(crate) struct Exposures<'a> {
    pub(crate) lines: Lines,
    /// One for each line.
    pub(crate) all: Vec<Exposure<'a>>,
}

impl<'a> Exposures<'a> {
    fn of(&self, x: usize, y: usize) -> &Exposure<'a> {
        match self.lines {
            Lines::One => &self.all[0],
            Lines::Rows => &self.all[y],
            Lines::Columns => &self.all[x],
        }
    }
}

impl ImagePlane {
    /// The image plane of a camera with square pixels.
    pub(crate) fn new(spec: &CameraSpec, world_from_camera: &Pose) -> Self {
        let intrinsics = spec.intrinsics();
        Self {
            width: spec.width,
            height: spec.height,
            origin: narrow3(world_from_camera.translation()),
            world_from_camera: narrow_mat(world_from_camera.rotation()),
            focal: to_f32(intrinsics.fx),
            centre: [to_f32(intrinsics.cx), to_f32(intrinsics.cy)],
            fisheye: spec.fisheye,
        }
    }

    /// The ray through image coordinates (pixels); of a pinhole, its distances are depths.
    fn ray(&self, x: f32, y: f32) -> Ray {
        Ray { origin: self.origin, direction: self.world_from_camera * self.direction(x, y) }
    }

    fn direction(&self, x: f32, y: f32) -> Vec3 {
        let [x, y] = [(x - self.centre[0]) / self.focal, (y - self.centre[1]) / self.focal];
        let Some(lens) = &self.fisheye else { return Vec3::new(x, y, 1.0) };
        let radius = x.hypot(y);
        let (sin, cos) = sin_cos(fisheye_angle(lens, f64::from(radius)));
        let across = to_f32(sin) / radius.max(f32::MIN_POSITIVE);
        Vec3::new(across * x, across * y, to_f32(cos))
    }

    /// Camera-space z at a distance along the ray through image coordinates; NaN behind the camera.
    fn depth(&self, x: f32, y: f32, t: f32) -> f32 {
        let z = self.direction(x, y).z;
        if z > 0.0 { t * z } else { f32::NAN }
    }
}

/// The central ray of a pixel.
#[derive(Clone, Copy, Debug)]
struct Probe {
    hit: Option<Hit>,
    lit: f32,
}

impl Probe {
    /// What must agree between neighbours for a pixel to lie inside a surface.
    fn key(&self) -> (Option<(Target, u8)>, bool) {
        (self.hit.map(|hit| (hit.target, hit.face)), self.lit > 0.5)
    }
}

/// The image of one or several moments. `clip_from_world` turns velocities.
pub(crate) fn capture(exposures: &Exposures<'_>, clip_from_world: &Pose) -> Capture {
    let ImagePlane { width, height, .. } = exposures.of(0, 0).plane;
    let mut probes = vec![Probe { hit: None, lit: 0.0 }; width * height];
    probes.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, probe) in row.iter_mut().enumerate() {
            let Exposure { moment, plane } = exposures.of(x, y);
            *probe = self::probe(moment, &plane.ray(x as f32 + 0.5, y as f32 + 0.5));
        }
    });
    let mut data = vec![0.0; width * height * 3];
    data.par_chunks_mut(width * 3).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
            let Exposure { moment, plane } = exposures.of(x, y);
            let colour = if is_edge(&probes, width, x, y) {
                supersampled(moment, plane, x, y)
            } else {
                textured(moment, plane, &probes[y * width + x], x, y)
            };
            pixel.copy_from_slice(&Light::encode(colour).to_array());
        }
    });
    let turn = narrow_mat(clip_from_world.rotation());
    let truth = |k: usize| -> (f32, [f32; 3], PixelLabel) {
        let Some(hit) = probes[k].hit else { return (f32::INFINITY, [0.0; 3], PixelLabel::Static) };
        let Exposure { moment, plane } = exposures.of(k % width, k / width);
        let [x, y] = [(k % width) as f32 + 0.5, (k / width) as f32 + 0.5];
        let point = plane.ray(x, y).at(hit.t);
        let velocity = turn * narrow3(moment.velocity(hit.target, point));
        let label = if moment.is_moving(hit.target) { PixelLabel::Dynamic } else { PixelLabel::Static };
        (plane.depth(x, y, hit.t), velocity.to_array(), label)
    };
    let mut capture = Capture {
        rgb: RgbImage { width, height, data },
        depth: Vec::with_capacity(width * height),
        velocity: Vec::with_capacity(width * height),
        labels: Vec::with_capacity(width * height),
    };
    for (depth, velocity, label) in (0..width * height).map(truth) {
        capture.depth.push(depth);
        capture.velocity.push(velocity);
        capture.labels.push(label);
    }
    capture
}

fn probe(moment: &Moment, ray: &Ray) -> Probe {
    let hit = moment.cast(ray, FAR);
    let lit = hit.as_ref().map_or(0.0, |hit| moment.lit(hit, ray.at(hit.t)));
    Probe { hit, lit }
}

/// Whether one of the four neighbours of a pixel shows another surface or shadow.
fn is_edge(probes: &[Probe], width: usize, x: usize, y: usize) -> bool {
    let at = y * width + x;
    let key = probes[at].key();
    let differs = |other: usize| probes[other].key() != key;
    (x > 0 && differs(at - 1))
        || (x + 1 < width && differs(at + 1))
        || (y > 0 && differs(at - width))
        || (at + width < probes.len() && differs(at + width))
}

/// Radiance of a pixel at an edge: the mean over rays.
fn supersampled(moment: &Moment, plane: &ImagePlane, x: usize, y: usize) -> Vec3 {
    let mut sum = Vec3::ZERO;
    let spread = SAMPLE_WIDTH / plane.focal;
    for (dx, dy) in SAMPLES {
        let ray = plane.ray(x as f32 + dx, y as f32 + dy);
        let probe = probe(moment, &ray);
        sum += compress(match probe.hit {
            None => moment.world.light.sky(ray.direction.normalize(), spread),
            Some(hit) => {
                let view = Viewed::new(&ray, &hit, spread);
                view.radiance(moment, &hit, probe.lit, &[ray.at(hit.t)])
            }
        });
    }
    expand(sum / SAMPLES.len() as f32)
}

/// Bounds what one sample at an edge may weigh, so that edges against bright sky do not look ragged.
fn compress(radiance: Vec3) -> Vec3 {
    radiance / (Vec3::ONE + radiance)
}

fn expand(compressed: Vec3) -> Vec3 {
    compressed / (Vec3::ONE - compressed.min(Vec3::splat(0.99)))
}

/// Radiance of a pixel inside a surface: the mean over texture samples on the tangent plane.
fn textured(moment: &Moment, plane: &ImagePlane, probe: &Probe, x: usize, y: usize) -> Vec3 {
    let ray = plane.ray(x as f32 + 0.5, y as f32 + 0.5);
    let spread = SAMPLE_WIDTH / plane.focal;
    let Some(hit) = probe.hit else { return moment.world.light.sky(ray.direction.normalize(), 2.0 * spread) };
    let point = ray.at(hit.t);
    let reach = (point - ray.origin).dot(hit.normal);
    let points = SAMPLES.map(|(dx, dy)| {
        let ray = plane.ray(x as f32 + dx, y as f32 + dy);
        let t = reach / ray.direction.dot(hit.normal);
        // A tangent plane seen from its edge leads nowhere near the pixel.
        if (0.5 * hit.t..2.0 * hit.t).contains(&t) { ray.at(t) } else { point }
    });
    Viewed::new(&ray, &hit, spread).radiance(moment, &hit, probe.lit, &points)
}

/// A surface as seen along a ray.
struct Viewed {
    point: Vec3,
    distance: f32,
    footprint: f32,
}

impl Viewed {
    /// `spread` is the width of a sample in radians at the middle of the image.
    fn new(ray: &Ray, hit: &Hit, spread: f32) -> Self {
        let length = ray.direction.length();
        let cosine = (ray.direction.dot(hit.normal) / length).abs().max(0.04);
        // Between the footprint's width across and along the direction of view.
        let footprint = hit.t * length * spread / cosine.sqrt();
        Self { point: ray.at(hit.t), distance: hit.t * length, footprint }
    }

    fn radiance(&self, moment: &Moment, hit: &Hit, lit: f32, points: &[Vec3]) -> Vec3 {
        let flat = matches!(hit.target, Target::Ground(Zone::Carriageway | Zone::Pavement));
        let open = if flat { moment.openness_beside_objects(self.point) } else { 1.0 };
        let mut sum = Vec3::ZERO;
        for &point in points {
            let texel = moment.texel(hit, point, self.footprint);
            sum += moment.radiance(hit, &texel, open, lit);
        }
        moment.world.light.hazed(sum / points.len() as f32, self.distance)
    }
}
