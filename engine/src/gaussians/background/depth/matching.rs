//! How alike what a pixel shows is to what other images show where it would be, at every depth that it may have.

use pulp::{Simd, WithSimd};

use super::{
    level::{Level, MAX_DIFFERENCE, NUM_DEPTHS},
    relative::RelativePose,
};
use crate::views::{NEAR, PinholeView, Projected, reduced::Reduced};

/// Hypotheses from one place at which the shift by a rolling shutter is worked out to the next.
const SHIFTED: usize = 8;

/// An image that views are matched against.
#[derive(Debug)]
pub(super) struct Source<'a> {
    pub(super) level: &'a Level,
    /// `[H, W]` its colours, grey levels; the fourth is 0.
    colours: Vec<[f32; 4]>,
    pose: RelativePose,
}

impl<'a> Source<'a> {
    /// The image `level` as `view` is matched against it.
    pub(super) fn new(level: &'a Level, view: &Reduced) -> Self {
        let colours = level.view.colours.iter().map(|&[r, g, b]| [f32::from(r), f32::from(g), f32::from(b), 0.0]);
        let pose = RelativePose::new(&view.pinhole, &level.view.pinhole);
        Self { level, colours: colours.collect(), pose }
    }
}

/// Costs (grey levels) of all depths of some pixels of a view; at most `unseen` of those that an image does not show.
pub(super) struct Matching<'a, 'b> {
    pub(super) level: &'a Level,
    pub(super) sources: &'a [Source<'b>],
    /// Inverse depth between two hypotheses, 1 / metres.
    pub(super) step: f32,
    /// Row-major index of the first pixel.
    pub(super) first: usize,
    /// `[pixels]`
    pub(super) unseen: &'a [f32],
    /// `[pixels]` starts at infinity.
    pub(super) costs: &'a mut [[f32; NUM_DEPTHS]],
}

impl WithSimd for Matching<'_, '_> {
    type Output = ();

    // No lanes are named here: the widest instructions of the machine are what this is compiled for.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for ((pixel, &unseen), costs) in (self.first..).zip(self.unseen).zip(self.costs) {
            for source in self.sources {
                match_along_ray(costs, unseen, self.step, self.level, pixel, source);
            }
        }
    }
}

/// Lowers the costs of the depths of `pixel` to those against `source`, or to `unseen` where that does not show them.
#[inline(always)]
fn match_along_ray(
    costs: &mut [f32; NUM_DEPTHS],
    unseen: f32,
    step: f32,
    level: &Level,
    pixel: usize,
    source: &Source<'_>,
) {
    let camera = &source.level.view.pinhole;
    let pose = source.pose.of_pixel(&level.view.pinhole, pixel, camera);
    let points = points(pose.start(&level.view.pinhole, pixel), pose.translation, step, camera);
    let places = places(&points, camera);
    let (colour, census) = (level.view.colours[pixel].map(f32::from), level.census[pixel]);
    for (cost, [u, v]) in costs.iter_mut().zip(places) {
        let here = if u.is_nan() {
            unseen
        } else {
            let other = bilinear(&source.colours, camera, u, v);
            let gap = (0..3).map(|k| (colour[k] - other[k]).abs()).sum::<f32>() / 3.0;
            let bits = census ^ source.level.census[Projected { u, v, depth: 1.0 }.pixel(camera.width)];
            gap.min(MAX_DIFFERENCE) + bits.count_ones() as f32
        };
        *cost = cost.min(here);
    }
}

/// The points at all inverse depths along a ray, times that, in the axes of a camera when each of them is exposed.
#[inline(always)]
fn points(start: [f32; 3], translation: [f32; 3], step: f32, camera: &PinholeView) -> [[f32; NUM_DEPTHS]; 3] {
    let mut points: [[f32; NUM_DEPTHS]; 3] =
        std::array::from_fn(|k| std::array::from_fn(|label| start[k] + label as f32 * step * translation[k]));
    let Some(shutter) = camera.shutter else { return points };
    // Along a ray, what a rolling shutter does changes slowly.
    let shift = |label: usize| {
        let at: [f32; 3] = std::array::from_fn(|k| start[k] + label as f32 * step * translation[k]);
        shutter.shift(&camera.lens(), at, label as f32 * step)
    };
    let mut last = shift(0);
    for first in (0..NUM_DEPTHS).step_by(SHIFTED) {
        let next = shift(first + SHIFTED);
        for (axis, (a, b)) in points.iter_mut().zip(last.into_iter().zip(next)) {
            for (k, at) in axis[first..].iter_mut().take(SHIFTED).enumerate() {
                *at = *at + a + k as f32 / SHIFTED as f32 * (b - a);
            }
        }
        last = next;
    }
    points
}

/// Where a camera shows such points, pixels; no number where it does not.
#[inline(always)]
fn places([x, y, z]: &[[f32; NUM_DEPTHS]; 3], camera: &PinholeView) -> [[f32; 2]; NUM_DEPTHS] {
    let (width, height) = (camera.width as f32, camera.height as f32);
    std::array::from_fn(|label| {
        let (u, v) = (camera.fx * x[label] / z[label] + camera.cx, camera.fy * y[label] / z[label] + camera.cy);
        let inside = (z[label] > NEAR) & (u >= 0.0) & (v >= 0.0) & (u < width) & (v < height);
        [if inside { u } else { f32::NAN }, v]
    })
}

/// The colour between four pixels.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the image")]
#[inline(always)]
fn bilinear(colours: &[[f32; 4]], camera: &PinholeView, u: f32, v: f32) -> [f32; 4] {
    let (width, height) = (camera.width, camera.height);
    let (x, y) = ((u - 0.5).clamp(0.0, (width - 1) as f32), (v - 0.5).clamp(0.0, (height - 1) as f32));
    let (column, row) = (x as usize, y as usize);
    let corner = row * width + column;
    let right = usize::from(column + 1 < width);
    let below = if row + 1 < height { width } else { 0 };
    let (a, b) = (x - column as f32, y - row as f32);
    let [tl, tr, bl, br] = [corner, corner + right, corner + below, corner + below + right].map(|i| colours[i]);
    std::array::from_fn(|k| {
        let line = |l: f32, r: f32| l + a * (r - l);
        let (top, bottom) = (line(tl[k], tr[k]), line(bl[k], br[k]));
        top + b * (bottom - top)
    })
}
