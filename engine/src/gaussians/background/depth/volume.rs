//! How well every depth that a pixel may have fits the other images and what else is known: a plane sweep.
//!
//! # Source
//! Collins, A space-sweep approach to true multi-image matching, 1996; census after Zabih and Woodfill, 1994.

use rayon::prelude::*;

use super::evidence::{Evidence, middle, share_of};
use crate::views::{
    NEAR, PinholeView, Projected,
    reduced::{Reduced, difference},
};

/// Hypotheses of a pixel.
pub(super) const NUM_LABELS: usize = 128;
/// The hypothesis that the pixel shows the own vehicle, which moves with the camera.
pub(super) const OWN_VEHICLE: usize = NUM_LABELS - 1;
/// The hypotheses `label * step` of the inverse depth; one label between them and the own vehicle is never chosen, so that
/// neighbours do not slide from one to the other.
pub(super) const NUM_DEPTHS: usize = NUM_LABELS - 2;
/// Costs are counted in quarters of a grey level.
const UNIT: f32 = 4.0;
/// Cost of a hypothesis that no other image shows, grey levels: about that of a right one which another image shows.
const UNSEEN: f32 = 20.0;
/// The same where the pixel may show the own vehicle, which would else be taken for something so near that no other image shows it.
const UNSEEN_BY_VEHICLE: f32 = 45.0;
/// Largest cost of a difference in colour, grey levels.
const MAX_DIFFERENCE: f32 = 60.0;
/// Cost of a step away from a return, and the most that a return costs, grey levels.
const RETURN_STEP: (f32, f32) = (40.0, 60.0);
/// Cost of a step away from the expected ground, and the most that it costs, grey levels.
const GROUND_STEP: (f32, f32) = (1.0, 20.0);
/// Cost of sky that is not infinitely far, grey levels.
const SKY: f32 = 50.0;
/// Cost of a depth behind the ground, grey levels.
const BEHIND_GROUND: f32 = 100.0;
/// Cost of being the own vehicle, without and with returns around the pixel, grey levels.
const OWN_VEHICLE_BIAS: (f32, f32) = (6.0, 21.0);
/// The own vehicle hides the ground up to this distance, metres.
const OWN_VEHICLE_RANGE: f32 = 15.0;
/// Cost of the own vehicle where it cannot be, and of the label that is never chosen.
const NEVER: (i16, i16) = (1500, 2000);
/// Share of the returns whose inverse depth the hypotheses reach, and how far they go beyond it.
const REACHED: (f32, f32) = (0.995, 1.1);
/// Smallest and largest of the nearest hypotheses, 1 / metres.
const NEAREST: (f32, f32) = (0.055, 0.63);

/// A view with the descriptors that are compared.
#[derive(Clone, Debug)]
pub(super) struct Level {
    /// The reduced view.
    pub(super) view: Reduced,
    /// `[H, W]` which neighbours in a 5 x 5 window are darker than the pixel, one bit each.
    census: Vec<u32>,
}

/// Costs of all hypotheses of all pixels.
#[derive(Debug)]
pub(super) struct Volume {
    /// Inverse depth between two labels, 1 / metres.
    pub(super) step: f32,
    /// `[H, W, NUM_LABELS]` quarters of a grey level.
    pub(super) costs: Vec<[i16; NUM_LABELS]>,
}

impl Level {
    /// The descriptors of a reduced view.
    pub(super) fn new(view: Reduced) -> Self {
        let census = census(&view);
        Self { view, census }
    }
}

/// The costs of `level`'s hypotheses against the images of `sources`, the best of these counting.
pub(super) fn volume(level: &Level, sources: &[&Level], evidence: &[Evidence]) -> Volume {
    let step = nearest_inverse(evidence) / (NUM_DEPTHS - 1) as f32;
    let poses: Vec<RelativePose> =
        sources.iter().map(|s| RelativePose::new(&level.view.pinhole, &s.view.pinhole)).collect();
    let costs_of = |pixel: usize| {
        let own = own_vehicle(level, pixel, sources, &evidence[pixel]);
        let unseen = if own.is_some() { UNSEEN_BY_VEHICLE } else { UNSEEN };
        let mut seen = [f32::INFINITY; NUM_DEPTHS];
        for (source, pose) in sources.iter().zip(&poses) {
            match_along_ray(&mut seen, unseen, step, level, pixel, source, pose);
        }
        with_evidence(&seen, &evidence[pixel], step, own)
    };
    Volume { step, costs: (0..evidence.len()).into_par_iter().with_min_len(512).map(costs_of).collect() }
}

/// The inverse depth of the nearest hypothesis: nearer than nearly all returns and than the ground that none fell on.
fn nearest_inverse(evidence: &[Evidence]) -> f32 {
    let mut returns: Vec<f32> = evidence.iter().filter(|e| e.weight > 0.0).map(|e| e.inverse).collect();
    returns.sort_by(f32::total_cmp);
    let nearest = returns.get(share_of(returns.len(), REACHED.0)).map_or(0.5, |w| w * REACHED.1);
    let ground = evidence.iter().map(|e| e.ground).fold(0.0, f32::max);
    nearest.max(NEAREST.0).max((ground * 1.05).min(NEAREST.1))
}

/// Hypotheses from one place at which the shift by a rolling shutter is worked out to the next.
const SHIFTED: usize = 8;

/// `source_from_view` of two cameras.
#[derive(Clone, Copy, Debug)]
pub(super) struct RelativePose {
    rotation: [[f32; 3]; 3],
    translation: [f32; 3],
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
    fn of_pixel(&self, view: &PinholeView, pixel: usize, source: &PinholeView) -> Self {
        if view.shutter.is_none() {
            return *self;
        }
        let at = middle(pixel, view.width);
        Self::new(&view.exposing([at.u, at.v]), source)
    }

    /// The ray of a pixel in the source's axes: `start + w * self.translation` is the point at inverse depth w, times w.
    fn start(&self, view: &PinholeView, pixel: usize) -> [f32; 3] {
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

/// Lowers the costs (grey levels) of the depths of `pixel` to those against `source`, or to `unseen` where that does not show them.
fn match_along_ray(
    costs: &mut [f32; NUM_DEPTHS],
    unseen: f32,
    step: f32,
    level: &Level,
    pixel: usize,
    source: &Level,
    pose: &RelativePose,
) {
    let pose = pose.of_pixel(&level.view.pinhole, pixel, &source.view.pinhole);
    let start = pose.start(&level.view.pinhole, pixel);
    let colour = level.view.colours[pixel].map(f32::from);
    let camera = &source.view.pinhole;
    let point =
        |label: usize| -> [f32; 3] { std::array::from_fn(|k| start[k] + label as f32 * step * pose.translation[k]) };
    // Along a ray, what a rolling shutter does changes slowly.
    let shift =
        |label: usize| camera.shutter.map(|shutter| shutter.shift(&camera.lens(), point(label), label as f32 * step));
    let (mut first, mut last) = (None, shift(0));
    for (label, cost) in costs.iter_mut().enumerate() {
        if label % SHIFTED == 0 {
            (first, last) = (last, shift(label + SHIFTED));
        }
        let share = (label % SHIFTED) as f32 / SHIFTED as f32;
        let at = point(label);
        let moved = first
            .zip(last)
            .map_or(at, |(a, b): ([f32; 3], [f32; 3])| std::array::from_fn(|k| at[k] + a[k] + share * (b[k] - a[k])));
        let here = match seen(moved, camera) {
            None => unseen,
            Some(at) => {
                let other = bilinear(&source.view, at);
                let gap = (0..3).map(|k| (colour[k] - other[k]).abs()).sum::<f32>() / 3.0;
                let bits = level.census[pixel] ^ source.census[at.pixel(camera.width)];
                gap.min(MAX_DIFFERENCE) + bits.count_ones() as f32
            }
        };
        *cost = cost.min(here);
    }
}

fn bilinear(view: &Reduced, at: Projected) -> [f32; 3] {
    let (width, height) = (view.pinhole.width, view.pinhole.height);
    let (x, y) = ((at.u - 0.5).clamp(0.0, (width - 1) as f32), (at.v - 0.5).clamp(0.0, (height - 1) as f32));
    let corner = Projected { u: x, v: y, depth: at.depth }.pixel(width);
    let right = usize::from(x + 1.0 < width as f32);
    let below = if y + 1.0 < height as f32 { width } else { 0 };
    let (a, b) = (x.fract(), y.fract());
    let [tl, tr, bl, br] = [corner, corner + right, corner + below, corner + below + right].map(|i| view.colours[i]);
    std::array::from_fn(|k| {
        let line = |l: u8, r: u8| f32::from(l) + a * (f32::from(r) - f32::from(l));
        let (top, bottom) = (line(tl[k], tr[k]), line(bl[k], br[k]));
        top + b * (bottom - top)
    })
}

/// The cost (grey levels) of showing the own vehicle, which looks the same in every image of the camera; `None` where it
/// cannot be: above the near ground, at a return of the view's own sweep, or without another image.
fn own_vehicle(level: &Level, pixel: usize, sources: &[&Level], evidence: &Evidence) -> Option<f32> {
    if evidence.floor <= 1.0 / OWN_VEHICLE_RANGE || evidence.weight >= 1.0 {
        return None;
    }
    let cost = |source: &&Level| {
        let colour = *source.view.colours.get(pixel)?;
        let bits = level.census[pixel] ^ source.census[pixel];
        Some(difference(level.view.colours[pixel], colour).min(MAX_DIFFERENCE) + bits.count_ones() as f32)
    };
    let same = |source: &&&Level| source.view.pinhole.width == level.view.pinhole.width;
    let worst = sources.iter().filter(same).filter_map(cost).reduce(f32::max)?;
    Some(worst + if evidence.near_returns { OWN_VEHICLE_BIAS.1 } else { OWN_VEHICLE_BIAS.0 })
}

/// A pixel's costs of all hypotheses, what the images say joined with what else is known.
fn with_evidence(seen: &[f32; NUM_DEPTHS], evidence: &Evidence, step: f32, own: Option<f32>) -> [i16; NUM_LABELS] {
    let mut costs = [NEVER.1; NUM_LABELS];
    let pull = |w: f32, target: f32, (slope, most): (f32, f32)| ((w - target).abs() / step * slope).min(most);
    for (label, (cost, &seen)) in costs.iter_mut().zip(seen).enumerate() {
        let w = label as f32 * step;
        let mut total = seen.min(UNSEEN + MAX_DIFFERENCE);
        if evidence.weight > 0.0 {
            total += evidence.weight * (pull(w, evidence.inverse, RETURN_STEP) - total);
        }
        if w < evidence.floor - step {
            total += BEHIND_GROUND;
        }
        if evidence.ground > 0.0 {
            total += pull(w, evidence.ground, GROUND_STEP);
        }
        if label > 0 {
            total += SKY * evidence.sky;
        }
        *cost = to_cost(total);
    }
    costs[OWN_VEHICLE] = own.map_or(NEVER.0, to_cost);
    costs
}

#[expect(clippy::cast_possible_truncation, reason = "the sum of the limits above is far below 32767 quarters")]
fn to_cost(grey_levels: f32) -> i16 {
    (grey_levels * UNIT) as i16
}

fn census(view: &Reduced) -> Vec<u32> {
    /// Neighbours must be darker by this much, summed over the channels, so that noise does not count.
    const MARGIN: u16 = 5;
    let (width, height) = (view.pinhole.width, view.pinhole.height);
    let grey: Vec<u16> = view.colours.iter().map(|c| c.iter().map(|&v| u16::from(v)).sum()).collect();
    let bits_of = |pixel: usize| {
        let (column, row) = (pixel % width, pixel / width);
        let around = |at: usize, k: usize, size: usize| (at + k).saturating_sub(2).min(size - 1);
        (0..25).fold(0, |bits, k| {
            let other = around(row, k / 5, height) * width + around(column, k % 5, width);
            bits << 1 | u32::from(grey[other] + MARGIN < grey[pixel])
        })
    };
    (0..grey.len()).into_par_iter().with_min_len(512).map(bits_of).collect()
}
