//! What the images that one camera takes one after the other say of its mount, and of when they are exposed.
//!
//! A return that was measured once is shown several times, from nearer each time. Where the camera is mounted or exposed otherwise than stated,
//! every image shows it beside its place, the nearer ones by more, so that they show other returns alike than those that are the same.

use std::fmt::Write as _;

use glam::DVec3;
use lgs_formats::{
    camera::{Readout, ReadoutDirection},
    camera_motion::CameraMotion,
    casts::to_f32,
    clip::Clip,
    image::PixelLabel,
};
use rayon::prelude::*;
use serde::Serialize;

use super::{
    alignment::{Change, Detail, FIXED, Fold, Free, MOUNT, Pair, Seen, align, shown},
    correlation,
    front::Front,
    mounts::Mount,
};
use crate::{
    parallel,
    points::{DepthGrid, PointCloud},
    views::View,
};

/// Way of a camera between two of its images that shows how it is mounted, metres.
const LEAST_WAY: f64 = 1.0;
/// Pairs of images of a return that are looked at.
const MOST_PAIRS: usize = 40_000;
/// Pairs without which a camera is left as it is stated, and those that two images must share to be asked.
const FEWEST_PAIRS: usize = 2000;
const FEWEST_SHARED: usize = 100;
/// Factors by which images are made smaller, one after the other, and the steps at each.
const LEVELS: [(usize, usize); 3] = [(4, 5), (2, 5), (1, 5)];
/// The levels that a readout is looked for at, where the mount was found before, and those at which all returns tell what their halves have told.
const FINE: usize = 1;
const FINEST: usize = 2;
/// What is unexplained must fall below this share of what it was as stated, for returns that had no part in finding the change ...
const LESS: f64 = 0.98;
/// ... for this share of the pairs, by the images that they are of.
const MOST: f64 = 2.0 / 3.0;
/// A readout beside a mount must explain more: what is unexplained falls below this share of what the mount alone leaves.
const RICHER: f64 = 0.99;
/// Shortest readout that shows, seconds.
const SHORTEST: f64 = 0.005;

/// How a camera is mounted and exposed against what the clip states, as its own images tell.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraFinding {
    /// How it is mounted; no turn and no shift where it is as stated.
    #[serde(flatten)]
    pub mount: Mount,
    /// When its images are exposed; `None` where that is as stated.
    pub readout: Option<Readout>,
    /// Share of the variance of detail at returns in one of its images that another one does not explain, as stated and as found.
    pub unexplained: [f64; 2],
}

impl CameraFinding {
    /// What was found, for people.
    pub fn in_words(&self) -> String {
        let Self { mount, readout, unexplained } = self;
        let [turn, shift] = [mount.turn, mount.shift].map(|vector| 1e3 * DVec3::from(vector).length());
        let mut words = format!("{}: ", mount.camera);
        if turn > 0.0 || shift > 0.0 {
            let _ = write!(words, "turned by {turn:.1} mrad and moved by {shift:.0} mm against what the clip states, ");
        }
        if let Some(Readout { seconds, middle, direction }) = readout {
            let way = match direction {
                ReadoutDirection::TopToBottom => "the top down",
                ReadoutDirection::BottomToTop => "the bottom up",
                ReadoutDirection::LeftToRight => "left to right",
                ReadoutDirection::RightToLeft => "right to left",
            };
            let [seconds, middle] = [seconds, middle].map(|time| 1e3 * time);
            let _ = write!(words, "read out from {way} in {seconds:.0} ms around {middle:+.0} ms, ");
        }
        let [stated, found] = unexplained.map(|share| 100.0 * share);
        format!("{words}as its images one after the other tell ({stated:.0} % unexplained, now {found:.0} %)")
    }
}

/// What may be otherwise than stated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Asked {
    pub(super) mount: bool,
    pub(super) readout: bool,
}

impl Asked {
    /// What is looked for in turn, simple things first.
    fn candidates(self) -> Vec<Free> {
        let mount = if self.mount { MOUNT } else { FIXED };
        let with = |edge: usize| std::array::from_fn(|k| mount[k] || k == 6 || k == edge);
        let readouts = self.readout.then(|| [with(8), with(7)]);
        self.mount.then_some(MOUNT).into_iter().chain(readouts.into_iter().flatten()).collect()
    }
}

/// Whether a camera is carried far enough, over `frames`, for its images to tell anything.
pub(super) fn is_carried(clip: &Clip, frames: &[usize], camera: &str) -> bool {
    let records = frames.iter().flat_map(|&frame| &clip.frames[frame].cameras).map(|record| &record.camera);
    let places: Vec<DVec3> =
        records.filter(|other| other.name == camera).map(|other| other.world_from_camera.translation()).collect();
    places.iter().any(|place| place.distance(places[0]) >= LEAST_WAY)
}

/// What the images of `camera` among `views` say of it, where it is otherwise than `clip` states.
pub(super) fn otherwise(
    clip: &Clip,
    cloud: &PointCloud,
    views: &[View],
    camera: &str,
    asked: Asked,
) -> Option<CameraFinding> {
    let own: Vec<&View> = views.iter().filter(|view| view.camera == camera).collect();
    let motions: Vec<Motion> = own.iter().filter_map(|view| Motion::of(clip, view)).collect();
    if motions.len() < own.len() {
        return None;
    }
    let pairs = pairs(cloud, &own, &motions);
    if pairs.len() < FEWEST_PAIRS {
        return None;
    }
    let levels: Vec<Vec<Detail>> =
        LEVELS.iter().map(|&(factor, _)| parallel::map(own.len(), 1, &|k| Detail::new(own[k], factor))).collect();
    let aligned =
        |free: Free, start: Change, from: usize, fold: Fold| -> Change {
            LEVELS.iter().zip(&levels).skip(from).fold(start, |change, (&(_, rounds), details)| {
                align(&pairs, details, &[change], &[free], fold, rounds)[0]
            })
        };
    let compared = |halves| Comparison::of(&pairs, &levels[FINEST], halves);
    let stated = compared([Change::default(); 2]);
    let mut simplest: Option<[Change; 2]> = None;
    let mut chosen: Option<(Free, [Change; 2], f64)> = None;
    for free in asked.candidates() {
        // Each half of the returns judges what the other half found.
        let (start, from) = simplest.map_or(([Change::default(); 2], 0), |found| (found, FINE));
        let halves = [aligned(free, start[0], from, Fold::Odd), aligned(free, start[1], from, Fold::Even)];
        simplest.get_or_insert(halves);
        let found = compared(halves);
        let share = found.mean() / stated.mean();
        let limit = chosen.map_or(LESS, |(.., simpler)| RICHER * simpler);
        // Both halves must tell a readout, and the same way.
        let [first, second] = halves.map(|half| half[7] + half[8]);
        let shows = !free[6] || first.abs().min(second.abs()) >= SHORTEST && first * second > 0.0;
        if shows && share < limit && found.agreed(&stated) >= MOST {
            chosen = Some((free, halves, share));
        }
    }
    let (free, [odd, even], share) = chosen?;
    let between = std::array::from_fn(|k| 0.5 * (odd[k] + even[k]));
    let change = aligned(free, between, FINEST, Fold::All);
    let [a, b, c, x, y, z, middle, across, down] = change;
    let direction = match (free[7], across + down > 0.0) {
        (false, true) => ReadoutDirection::TopToBottom,
        (false, false) => ReadoutDirection::BottomToTop,
        (true, true) => ReadoutDirection::LeftToRight,
        (true, false) => ReadoutDirection::RightToLeft,
    };
    Some(CameraFinding {
        mount: Mount { camera: camera.to_owned(), turn: [a, b, c], shift: [x, y, z] },
        readout: free[6].then(|| Readout { seconds: (across + down).abs(), direction, middle }),
        unexplained: [stated.mean(), share * stated.mean()],
    })
}

/// How a camera moves when it takes an image, in its own axes.
struct Motion {
    turn: DVec3,
    drift: DVec3,
}

impl Motion {
    fn of(clip: &Clip, view: &View) -> Option<Self> {
        let cameras = &clip.frames.get(view.frame)?.cameras;
        let index = cameras.iter().position(|record| record.camera.name == view.camera)?;
        let CameraMotion { turn, velocity } = CameraMotion::of(clip, view.frame, index);
        let drift = cameras[index].camera.world_from_camera.rotation().transpose() * velocity;
        Some(Self { turn, drift })
    }

    /// How a standing point at a place in the camera's axes moves there, metres a second.
    fn rate(&self, place: [f32; 3]) -> [f32; 3] {
        let place = DVec3::from(place.map(f64::from));
        (-(self.drift + self.turn.cross(place))).to_array().map(to_f32)
    }
}

/// Returns that two of the images show, one of them of the return's own frame; by images.
fn pairs(cloud: &PointCloud, views: &[&View], motions: &[Motion]) -> Vec<Pair> {
    let grid = |view: &View| DepthGrid::new(view.pinhole.width, view.pinhole.height, &view.depth_samples);
    let grids = parallel::map(views.len(), 1, &|k| grid(views[k]));
    let fronts = parallel::map(views.len(), 1, &|k| Front::new(cloud, &views[k].pinhole));
    let seen = |point: usize, k: usize| -> Option<Seen> {
        let view = views[k];
        let camera = &view.pinhole;
        let at = camera.project(cloud.positions[point])?;
        let ignored = view.labels.as_ref().is_some_and(|l| l[at.pixel(camera.width)] == PixelLabel::Ignored);
        let own = view.frame == cloud.frames[point] as usize;
        let place = [(at.u - camera.cx) / camera.fx, (at.v - camera.cy) / camera.fy, 1.0].map(|x| x * at.depth);
        let shown = !ignored && fronts[k].shows(at) && (own || !grids[k].sees_through(at));
        shown.then(|| Seen { view: k, camera: 0, place, rate: motions[k].rate(place) })
    };
    let of_point = |point: usize| -> Vec<Pair> {
        let first = views.iter().position(|view| view.frame == cloud.frames[point] as usize);
        let Some(first) = first.and_then(|k| seen(point, k)) else { return Vec::new() };
        let others = (0..views.len()).filter(|&k| k != first.view).filter_map(|k| seen(point, k));
        others.map(|second| Pair { point, seen: [first, second] }).collect()
    };
    let found: Vec<Pair> = (0..cloud.len()).into_par_iter().flat_map_iter(of_point).collect();
    let step = found.len().div_ceil(MOST_PAIRS).max(1);
    let mut found: Vec<Pair> = found.into_iter().step_by(step).collect();
    found.sort_by_key(|pair| pair.seen.map(|seen| seen.view));
    found
}

/// How much of the detail in one image others do not explain, for each two images.
struct Comparison {
    /// Number of pairs, and what is unexplained of them.
    images: Vec<(f64, f64)>,
}

impl Comparison {
    /// That of the camera changed as the first of `halves` says for even returns, as the second says for odd ones.
    fn of(pairs: &[Pair], details: &[Detail], halves: [Change; 2]) -> Self {
        let mut images = Vec::new();
        for (fold, change) in [Fold::Even, Fold::Odd].into_iter().zip(halves) {
            for both in pairs.chunk_by(|a, b| a.seen.map(|seen| seen.view) == b.seen.map(|seen| seen.view)) {
                let values = shown(both, details, &[change], fold);
                let unexplained = 1.0 - correlation(values.iter().copied()).powi(2);
                let told = values.len() >= FEWEST_SHARED;
                images.push(if told { (values.len() as f64, unexplained) } else { (0.0, 0.0) });
            }
        }
        Self { images }
    }

    fn mean(&self) -> f64 {
        let total: f64 = self.images.iter().map(|(count, _)| count).sum();
        self.images.iter().map(|(count, unexplained)| count * unexplained).sum::<f64>() / total
    }

    /// The share of the pairs whose images leave less unexplained than `other` does.
    fn agreed(&self, other: &Self) -> f64 {
        let total: f64 = self.images.iter().map(|(count, _)| count).sum();
        let better = self.images.iter().zip(&other.images).filter(|((_, own), (_, other))| own < other);
        better.map(|((count, _), _)| count).sum::<f64>() / total
    }
}
