//! Lenses that the images know nothing of: data sets state the distortion of cameras whose images were rectified before.
//!
//! The returns tell. What two images show of the same returns is more alike under the right lens, whether one camera took them one after the
//! other or two of a rig side by side.

use lgs_formats::{camera::Distortion, clip_dir::ClipDir};
use serde::{Deserialize, Serialize};

use super::{cameras_of, correlation};
use crate::{
    parallel,
    points::{self, DepthGrid, PointCloud},
    views::{Selection, View},
    words::Words,
};

/// Returns that two images must share.
const SHARED: usize = 200;
/// What the disagreement without the lenses must be below, a share of that with them ...
const LESS: f64 = 0.95;
/// ... and the share of the compared returns whose pair of images says so.
const MOST: f64 = 0.8;
/// Darkness that logarithms of brightness end at.
const DARKEST: f32 = 4.0 / 255.0;

/// Which lens distortion images have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lenses {
    /// What the clip states, unless the returns say that the images were rectified before.
    #[default]
    Auto,
    /// What the clip states.
    Stated,
}

impl Words for Lenses {
    const WORDS: &[(&str, Self, &str)] = &[
        ("auto", Self::Auto, "What the clip states, unless the returns say that the images were rectified before"),
        ("stated", Self::Stated, "What the clip states"),
    ];
}

/// What the returns say of the lenses of a clip.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LensFinding {
    /// The cameras whose images are rectified already.
    pub cameras: Vec<String>,
    /// Share of the variance of brightness of returns in one image that another one does not explain, under the lenses that the clip
    /// states, and without.
    pub unexplained: [f64; 2],
}

impl LensFinding {
    /// What was found, for people.
    pub fn in_words(&self) -> String {
        let [stated, without] = self.unexplained.map(|share| 100.0 * share);
        format!(
            "images of {} show returns alike without the lens distortion that the clip states ({without:.0} % unexplained, {stated:.0} % with it): \
             taken as rectified already",
            self.cameras.join(", ")
        )
    }
}

/// Two images of the same returns.
struct Pair {
    count: f64,
    unexplained: [f64; 2],
}

/// The cameras with a stated lens distortion, other than fisheyes.
pub(super) fn distorted(dir: &ClipDir, frames: &[usize], selection: &Selection) -> Vec<String> {
    cameras_of(
        dir,
        frames,
        selection,
        &|_, record| matches!(record.camera.distortion, Some(Distortion::BrownConrady(lens)) if lens.iter().any(|&k| k != 0.0)),
    )
}

/// What the returns say of the lenses of `cameras`, whose images are `stated` as the clip has them and `without` distortion, where they say
/// that the images were rectified before.
pub(super) fn rectified(
    cloud: &PointCloud,
    stated: &[View],
    without: &[View],
    cameras: &[String],
) -> Option<LensFinding> {
    let own: Vec<usize> = (0..stated.len()).filter(|&k| cameras.contains(&stated[k].camera)).collect();
    let pairs = pairs(cloud, stated, without, &own);
    let total: f64 = pairs.iter().map(|pair| pair.count).sum();
    let mean = |k: usize| pairs.iter().map(|pair| pair.count * pair.unexplained[k]).sum::<f64>() / total;
    let agreed: f64 = pairs.iter().filter(|p| p.unexplained[1] < p.unexplained[0]).map(|pair| pair.count).sum();
    let unexplained = [mean(0), mean(1)];
    let believed = total > 0.0 && unexplained[1] < LESS * unexplained[0] && agreed >= MOST * total;
    believed.then(|| LensFinding { cameras: cameras.to_vec(), unexplained })
}

/// Each of the `own` images with the next of its camera, and with those beside it.
fn pairs(cloud: &PointCloud, stated: &[View], without: &[View], own: &[usize]) -> Vec<Pair> {
    let next = |&i: &usize| {
        let later = |&j: &usize| stated[j].camera == stated[i].camera && stated[j].frame > stated[i].frame;
        own.iter().copied().filter(later).min_by_key(|&j| stated[j].frame)
    };
    let beside = |&i: &usize| own.iter().copied().filter(move |&j| j > i && stated[j].frame == stated[i].frame);
    let all: Vec<[usize; 2]> =
        own.iter().flat_map(|i| next(i).into_iter().chain(beside(i)).map(move |j| [*i, j])).collect();
    let grid = |view: &View| DepthGrid::new(view.pinhole.width, view.pinhole.height, &view.depth_samples);
    let grids = parallel::map(stated.len(), 1, &|k| grid(&stated[k]));
    parallel::filter_map(all.len(), 1, &|i| pair(cloud, all[i], [stated, without], &grids))
}

fn pair(cloud: &PointCloud, both: [usize; 2], lenses: [&[View]; 2], grids: &[DepthGrid]) -> Option<Pair> {
    let range = |i: usize| {
        let frame = lenses[0][i].frame;
        cloud.frames.partition_point(|&f| (f as usize) < frame)..cloud.frames.partition_point(|&f| f as usize <= frame)
    };
    let brightness = |point: usize| -> Option<[[f64; 2]; 2]> {
        let mut found = [[0.0; 2]; 2];
        for (k, &i) in both.iter().enumerate() {
            let at = lenses[0][i].pinhole.project(cloud.positions[point])?;
            if grids[i].covers(at) {
                return None;
            }
            for (lens, views) in lenses.iter().enumerate() {
                let colour = points::sample(&views[i], at)?;
                found[lens][k] = f64::from(colour.iter().sum::<f32>() / 3.0 + DARKEST).ln();
            }
        }
        Some(found)
    };
    let shared: Vec<[[f64; 2]; 2]> = range(both[0]).filter_map(brightness).collect();
    let unexplained = |lens: usize| 1.0 - correlation(shared.iter().map(|found| found[lens])).powi(2);
    (shared.len() >= SHARED).then(|| Pair { count: shared.len() as f64, unexplained: [unexplained(0), unexplained(1)] })
}
