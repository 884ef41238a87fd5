//! Mounts: where the cameras of a rig are, against each other.

use std::fmt::Write as _;

use glam::{DQuat, DVec3};
use lgs_formats::{
    clip::{CameraRecord, Frame},
    clip_dir::ClipDir,
    image::PixelLabel,
    pose::Pose,
};
use rayon::prelude::*;
use serde::Serialize;

use super::{
    alignment::{BELIEF, Change, Detail, FIXED, Fold, Free, MOUNT, Pair, Seen, align, shown},
    cameras_of, correlation,
};
use crate::{
    parallel,
    points::{DepthGrid, PointCloud},
    views::{Selection, View},
};

/// Frames before and after a return's own in which other cameras may show it.
const FRAMES_AROUND: usize = 1;
/// Pairs of images of a return that are looked at.
const MOST_PAIRS: usize = 100_000;
/// Pairs of a camera that say anything of its mount.
const FEWEST_PAIRS: usize = 400;
/// Factors by which images are made smaller, one after the other, and the steps at each.
const LEVELS: [(usize, usize); 3] = [(4, 6), (2, 5), (1, 5)];
/// What is unexplained between a camera and the others must fall below this share of what it was, for returns that had no part in finding where
/// it is mounted.
const LESS: f64 = 0.95;
/// Changes of the others against a camera that stays in place of the first must be below this share of those against the first.
const STEADIER: f64 = 0.9;

/// What returns and images say of the mounts of a clip's cameras.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MountFinding {
    /// The camera that stays where it is stated.
    pub reference: String,
    /// Those that are mounted otherwise than stated.
    pub cameras: Vec<Mount>,
    /// Share of the variance of detail at returns in an image of one of them that an image of another camera does not explain, mounted as stated
    /// and as found.
    pub unexplained: [f64; 2],
}

/// How a camera is mounted against what the clip states, in its own stated axes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Mount {
    /// Name of the camera.
    pub camera: String,
    /// Axis of its turn times the angle, radians.
    pub turn: [f64; 3],
    /// What it is moved by, metres.
    pub shift: [f64; 3],
}

impl MountFinding {
    /// What was found, for people.
    pub fn in_words(&self) -> String {
        let mut words = String::new();
        for Mount { camera, turn, shift } in &self.cameras {
            let [turn, shift] = [*turn, *shift].map(|vector| 1e3 * DVec3::from(vector).length());
            let _ = write!(words, "{camera} by {turn:.1} mrad and {shift:.0} mm, ");
        }
        let [stated, found] = self.unexplained.map(|share| 100.0 * share);
        format!(
            "turned and moved against what the clip states, until they show the same returns alike: {words}{} stays ({stated:.0} % unexplained, \
             now {found:.0} %)",
            self.reference
        )
    }
}

impl Mount {
    /// The camera as it is mounted, in the axes of the one that is stated.
    pub(super) fn stated_from_found(&self) -> Pose {
        let turn = DQuat::from_scaled_axis(DVec3::from(self.turn));
        Pose::new(glam::DMat3::from_quat(turn), DVec3::from(self.shift))
    }
}

/// The cameras whose mounts can be told: not those that are parts of one image, which are turned as one.
pub(super) fn separate(dir: &ClipDir, frames: &[usize], selection: &Selection) -> Vec<String> {
    let parts = |frame: &Frame, record: &CameraRecord| {
        frame.cameras.iter().filter(|other| other.file == record.file).count() > 1
    };
    cameras_of(dir, frames, selection, &|frame, record| !parts(frame, record))
}

/// What `views` say of the mounts of the cameras `names`, where they are otherwise than stated against the camera `reference` or else the one
/// against which they are least so.
pub(super) fn otherwise(
    cloud: &PointCloud,
    views: &[View],
    names: &[String],
    reference: Option<&str>,
) -> Option<MountFinding> {
    let place = |name: &str| names.iter().position(|other| other == name);
    let chosen = reference.and_then(place);
    let cameras: Vec<Option<usize>> = views.iter().map(|view| place(&view.camera)).collect();
    let pairs = pairs(cloud, views, &cameras);
    let fit_against = |reference: usize| Some((reference, fit(&pairs, views, names.len(), reference)?));
    let mut found = fit_against(chosen.unwrap_or(0))?;
    if chosen.is_none() {
        found = steadiest(&found.1.0, views, &cameras).and_then(fit_against).unwrap_or(found);
    }
    let (reference, (changes, unexplained)) = found;
    let mount = |(name, [a, b, c, x, y, z, ..]): (&String, Change)| Mount {
        camera: name.clone(),
        turn: [a, b, c],
        shift: [x, y, z],
    };
    let cameras = names.iter().zip(changes).filter(|(_, change)| *change != Change::default()).map(mount).collect();
    Some(MountFinding { reference: names[reference].clone(), cameras, unexplained })
}

/// The camera other than the first against which the cameras that changed did so least, by the sum of turns and shifts, which a single one
/// that is wrong sways little; `None` where it is not clearly less than against the first.
fn steadiest(changes: &[Change], views: &[View], cameras: &[Option<usize>]) -> Option<usize> {
    let in_clip = |camera: usize| -> Option<[DVec3; 2]> {
        if camera > 0 && changes[camera] == Change::default() {
            return None;
        }
        let view = &views[cameras.iter().position(|&own| own == Some(camera))?];
        let rows = view.pinhole.camera_from_clip.map(|row| DVec3::new(row[0].into(), row[1].into(), row[2].into()));
        let change = &changes[camera];
        Some([0, 3].map(|k| (0..3).map(|axis| rows[axis] * change[k + axis]).sum()))
    };
    let vectors: Vec<Option<[DVec3; 2]>> = (0..changes.len()).map(in_clip).collect();
    let total = |own: &[DVec3; 2]| -> f64 {
        let apart = |other: &[DVec3; 2]| (0..2).map(|k| (other[k] - own[k]).length() / BELIEF[3 * k]).sum::<f64>();
        vectors.iter().flatten().map(apart).sum()
    };
    let totals: Vec<f64> = vectors.iter().map(|own| own.as_ref().map_or(f64::INFINITY, total)).collect();
    let least = (0..totals.len()).min_by(|&a, &b| totals[a].total_cmp(&totals[b]))?;
    (totals[least] < STEADIER * totals[0]).then_some(least)
}

/// Returns that images of two cameras show, one of them of the return's own frame.
fn pairs(cloud: &PointCloud, views: &[View], cameras: &[Option<usize>]) -> Vec<Pair> {
    let mut frames: Vec<usize> = views.iter().map(|view| view.frame).collect();
    frames.dedup();
    let rank = |frame: usize| frames.partition_point(|&f| f < frame);
    let grid = |view: &View| DepthGrid::new(view.pinhole.width, view.pinhole.height, &view.depth_samples);
    let grids = parallel::map(views.len(), 1, &|k| grid(&views[k]));
    let point_pairs = |point: usize| -> Vec<Pair> {
        let own = cloud.frames[point] as usize;
        let shown = |k: usize| -> Option<(usize, [f32; 3])> {
            let view = &views[k];
            if rank(view.frame).abs_diff(rank(own)) > FRAMES_AROUND {
                return None;
            }
            let at = view.pinhole.project(cloud.positions[point])?;
            let ignored = view.labels.as_ref().is_some_and(|l| l[at.pixel(view.pinhole.width)] == PixelLabel::Ignored);
            let seen = !ignored && !grids[k].covers(at) && (view.frame == own || !grids[k].sees_through(at));
            let camera = &view.pinhole;
            let place = [(at.u - camera.cx) / camera.fx, (at.v - camera.cy) / camera.fy, 1.0].map(|x| x * at.depth);
            seen.then_some((k, place))
        };
        let all: Vec<(usize, [f32; 3])> = (0..views.len()).filter_map(shown).collect();
        let mut found = Vec::new();
        for (i, &(a, in_a)) in all.iter().enumerate() {
            for &(b, in_b) in &all[i + 1..] {
                let Some((first, second)) = cameras[a].zip(cameras[b]) else { continue };
                if first != second && (views[a].frame == own || views[b].frame == own) {
                    let seen = [(a, first, in_a), (b, second, in_b)];
                    let seen = seen.map(|(view, camera, place)| Seen { view, camera, place, rate: [0.0; 3] });
                    found.push(Pair { point, seen });
                }
            }
        }
        found
    };
    let found: Vec<Pair> = (0..cloud.len()).into_par_iter().flat_map_iter(point_pairs).collect();
    let step = found.len().div_ceil(MOST_PAIRS).max(1);
    found.into_iter().step_by(step).collect()
}

/// How each camera is to be changed, and what is unexplained before and after; `None` where all are where they are stated, as far as can be told.
fn fit(pairs: &[Pair], views: &[View], num_cameras: usize, reference: usize) -> Option<(Vec<Change>, [f64; 2])> {
    let has_camera = |camera: usize| move |pair: &Pair| pair.seen.iter().any(|seen| seen.camera == camera);
    let mut free: Vec<bool> = (0..num_cameras)
        .map(|c| c != reference && pairs.iter().filter(|pair| has_camera(c)(pair)).count() >= FEWEST_PAIRS)
        .collect();
    let levels: Vec<Vec<Detail>> =
        LEVELS.iter().map(|&(factor, _)| parallel::map(views.len(), 1, &|k| Detail::new(&views[k], factor))).collect();
    let stated = vec![Change::default(); num_cameras];
    let finest = &levels[LEVELS.len() - 1];
    // Share of the variance of the chosen pairs that one image leaves unexplained of the other, and their number.
    let unexplained = |changes: &[Change], fold: Fold, chosen: &(dyn Fn(&Pair) -> bool + Sync)| {
        let pairs: Vec<Pair> = pairs.iter().filter(|pair| chosen(pair)).copied().collect();
        let values = shown(&pairs, finest, changes, fold);
        (1.0 - correlation(values.iter().copied()).powi(2), values.len())
    };
    let aligned = |free: &[bool], fold: Fold| {
        let free: Vec<Free> = free.iter().map(|&free| if free { MOUNT } else { FIXED }).collect();
        LEVELS.iter().zip(&levels).fold(stated.clone(), |changes, (&(_, rounds), details)| {
            align(pairs, details, &changes, &free, fold, rounds)
        })
    };
    // Each half of the returns judges what the other half found.
    while free.contains(&true) {
        let [even, odd] = [Fold::Even, Fold::Odd].map(|fold| aligned(&free, fold));
        let halves = [(&odd, Fold::Even), (&even, Fold::Odd)];
        let shares = |chosen: &(dyn Fn(&Pair) -> bool + Sync)| {
            let (mut sums, mut total) = ([0.0; 2], 0.0);
            for (found, fold) in halves {
                for (sum, changes) in sums.iter_mut().zip([&stated, found]) {
                    let (share, count) = unexplained(changes, fold, chosen);
                    *sum += share * count as f64;
                    total += count as f64 / 2.0;
                }
            }
            sums.map(|sum| sum / total)
        };
        let better: Vec<bool> = (0..num_cameras)
            .map(|camera| {
                let [before, after] = shares(&has_camera(camera));
                free[camera] && after < LESS * before
            })
            .collect();
        if better == free {
            let moved = |pair: &Pair| pair.seen.iter().any(|seen| free[seen.camera]);
            return Some((aligned(&free, Fold::All), shares(&moved)));
        }
        free = better;
    }
    None
}
