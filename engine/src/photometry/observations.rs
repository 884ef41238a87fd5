//! The same places in several images: what tells how their cameras differ.

use std::ops::Range;

use lgs_formats::{casts::to_f32, image::PixelLabel};

use crate::{
    parallel,
    points::DepthGrid,
    views::{DepthSample, Projected, View, light, off_axis},
};

/// Places that are looked at in all, over all views.
const MOST_PLACES: usize = 60_000;
/// Frames before and after its own in which a place is looked for.
const FRAMES_AROUND: usize = 2;
/// Darker than this a channel says little: an eighth of it is a step of eight bits.
const DARKEST: f32 = 8.0 / 255.0;
/// Brighter than this a channel may be clipped.
const BRIGHTEST: f32 = 0.96;
/// Most that pixels around a place may differ, as a share of its own brightness above [`FLAT_FLOOR`]: an edge a pixel aside would
/// show as another colour.
const FLAT_SHARE: f32 = 0.15;
const FLAT_FLOOR: f32 = 0.03;
/// Sky begins this share of the image's height above the highest returns ...
const ABOVE_RETURNS: f32 = 0.04;
/// ... among the columns within this share of its width.
const BESIDE: f32 = 0.04;
/// Distance of the sky, metres: cameras of a drive see no parallax there.
const SKY: f32 = 1e5;

/// One place in one image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Observation {
    /// Index of the view.
    pub(super) view: usize,
    /// Natural logarithm of its colour, or of its light.
    pub(super) log: [f64; 3],
    /// See [`off_axis`].
    pub(super) off_axis: f64,
    /// How much it says: 1 for a bright colour, less for a dark one, whose logarithm is noisy.
    pub(super) weight: f64,
}

/// Places that at least two images show, each a run of observations.
#[derive(Clone, Debug, Default)]
pub(super) struct Observations {
    /// All of them, place by place.
    pub(super) all: Vec<Observation>,
    /// Where the run of each place lies.
    pub(super) places: Vec<Range<usize>>,
}

impl Observations {
    /// The same of the light that a tone curve with a shoulder shows so.
    pub(super) fn of_light(mut self) -> Self {
        let of_log = |log: f64| f64::from(light(to_f32(log.exp()))).ln();
        self.all.iter_mut().for_each(|seen| seen.log = seen.log.map(of_log));
        self
    }
}

/// What `views` show of the same places: returns of their sweeps, and directions in which there is sky.
pub(super) fn observe(views: &[View]) -> Observations {
    let seen: Vec<Seen<'_>> = parallel::map(views.len(), 1, &|i| Seen::of(&views[i]));
    let frames: Vec<usize> = distinct(views.iter().map(|view| view.frame));
    let near = |a: usize, b: usize| {
        let rank = |frame: usize| frames.partition_point(|&f| f < frame);
        rank(a).abs_diff(rank(b)) <= FRAMES_AROUND
    };
    let most = (MOST_PLACES / (2 * views.len().max(1))).max(1);
    let of_view = |own: usize| -> Vec<Vec<Observation>> {
        let from = &seen[own];
        let others =
            || seen.iter().enumerate().filter(|(k, other)| *k != own && near(other.view.frame, from.view.frame));
        let follow = |start: Projected, is_sky: bool| {
            let place = from.view.pinhole.unproject(start);
            let mut found = vec![from.observe(own, start)?];
            for (k, other) in others() {
                let at = other.view.pinhole.project(place);
                let shown = at.filter(|&at| if is_sky { other.is_sky(at) } else { other.shows(at, from.view) });
                found.extend(shown.and_then(|at| other.observe(k, at)));
            }
            (found.len() > 1).then_some(found)
        };
        let returns = thinned(from.returns(), most).filter_map(|at| follow(at, false));
        let sky = thinned(from.sky(), most).filter_map(|at| follow(at, true));
        returns.chain(sky).collect()
    };
    let found: Vec<Vec<Vec<Observation>>> = parallel::map(seen.len(), 1, &of_view);
    let mut result = Observations::default();
    for place in found.into_iter().flatten() {
        let start = result.all.len();
        result.all.extend(place);
        result.places.push(start..result.all.len());
    }
    result
}

/// Every so many of `all`, so that at most `most` are left.
fn thinned<T>(all: Vec<T>, most: usize) -> impl Iterator<Item = T> {
    let step = all.len().div_ceil(most).max(1);
    all.into_iter().step_by(step)
}

fn distinct(values: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut values: Vec<usize> = values.collect();
    values.sort_unstable();
    values.dedup();
    values
}

/// A view and what its sweep says of it.
struct Seen<'a> {
    view: &'a View,
    depths: DepthGrid,
    /// `[W]` first row below which there may be something, pixels.
    sky_ends: Vec<f32>,
}

impl<'a> Seen<'a> {
    fn of(view: &'a View) -> Self {
        let (width, height) = (view.pinhole.width, view.pinhole.height);
        let mut tops = vec![height; width];
        for sample in &view.depth_samples {
            let (row, column) = (sample.pixel as usize / width, sample.pixel as usize % width);
            tops[column] = tops[column].min(row);
        }
        let beside = share(BESIDE, width);
        // A column without any return nearby says nothing of where the sky ends.
        let end = |column: usize| {
            let around = &tops[column.saturating_sub(beside)..(column + beside + 1).min(width)];
            let top = around.iter().copied().min().filter(|&top| top < height).unwrap_or(0);
            top as f32 - ABOVE_RETURNS * height as f32
        };
        let sky_ends = (0..width).map(end).collect();
        Self { view, depths: DepthGrid::new(width, height, &view.depth_samples), sky_ends }
    }

    /// Where its returns are in its image.
    fn returns(&self) -> Vec<Projected> {
        let width = self.view.pinhole.width;
        let middle = |&DepthSample { pixel, depth }: &DepthSample| {
            let (row, column) = (pixel as usize / width, pixel as usize % width);
            Projected { u: column as f32 + 0.5, v: row as f32 + 0.5, depth }
        };
        self.view.depth_samples.iter().map(middle).filter(|&at| !self.depths.covers(at)).collect()
    }

    /// Image positions of the sky.
    fn sky(&self) -> Vec<Projected> {
        let (width, height) = (self.view.pinhole.width, self.view.pinhole.height);
        let step = (width / 96).max(1);
        let rows = (step / 2..height).step_by(step);
        let all = rows.flat_map(|row| (step / 2..width).step_by(step).map(move |column| (row, column)));
        let at = all.map(|(row, column)| Projected { u: column as f32 + 0.5, v: row as f32 + 0.5, depth: SKY });
        at.filter(|&at| self.is_sky(at)).collect()
    }

    fn is_sky(&self, at: Projected) -> bool {
        let column = at.pixel(self.view.pinhole.width) % self.view.pinhole.width;
        at.v < self.sky_ends[column]
    }

    /// Whether a return that `from` shows is seen at `at`.
    fn shows(&self, at: Projected, from: &View) -> bool {
        !self.depths.covers(at) && (self.view.frame == from.frame || !self.depths.sees_through(at))
    }

    /// The colour around `at`; `None` where it says nothing: at an edge, too dark or too bright, ignored, at the image's rim.
    fn observe(&self, index: usize, at: Projected) -> Option<Observation> {
        let (width, height) = (self.view.pinhole.width, self.view.pinhole.height);
        let pixel = at.pixel(width);
        let (row, column) = (pixel / width, pixel % width);
        if row == 0 || column == 0 || row + 1 >= height || column + 1 >= width {
            return None;
        }
        let (mut sum, mut least, mut most) = ([0.0_f32; 3], [f32::INFINITY; 3], [0.0_f32; 3]);
        for near in (row - 1..row + 2).flat_map(|r| (column - 1..column + 2).map(move |c| r * width + c)) {
            if self.view.labels.as_ref().is_some_and(|labels| labels[near] == PixelLabel::Ignored) {
                return None;
            }
            for k in 0..3 {
                let value = self.view.image.data[3 * near + k];
                sum[k] += value;
                least[k] = least[k].min(value);
                most[k] = most[k].max(value);
            }
        }
        let mean = sum.map(|sum| sum / 9.0);
        let brightness = mean.iter().sum::<f32>() / 3.0;
        let flat = (0..3).all(|k| most[k] - least[k] <= FLAT_FLOOR + FLAT_SHARE * brightness);
        let told = (0..3).all(|k| mean[k] >= DARKEST && most[k] <= BRIGHTEST);
        (flat && told).then(|| Observation {
            view: index,
            log: mean.map(|value| f64::from(value).ln()),
            off_axis: f64::from(off_axis(&self.view.pinhole, at.u, at.v)),
            weight: f64::from(brightness / (brightness + 4.0 * DARKEST)),
        })
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a part of a length in pixels")]
fn share(share: f32, length: usize) -> usize {
    (share * length as f32) as usize
}
