//! Lenses that the images know nothing of: data sets state the distortion of cameras whose images were rectified before.
//!
//! The returns tell. What two images show of the same returns is more alike under the right lens, whether one camera took them one after the
//! other or two of a rig side by side.

use lgs_formats::{camera::Distortion, clip_dir::ClipDir, image::ImageSize};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{
    error::Result,
    points::{self, DepthGrid, PointCloud},
    views::{ClipFrame, Role, Selection, View, load_views},
};

/// Frames that are looked at.
const FRAMES: usize = 5;
/// Width to which images are reduced by a whole factor, at least, pixels.
const WIDTH: usize = 640;
/// Returns that two images must share.
const SHARED: usize = 200;
/// What the disagreement without the lenses must be below, a share of that with them ...
const LESS: f64 = 0.95;
/// ... and the share of the compared returns whose pair of images says so.
const MOST: f64 = 0.8;
/// Darkness that logarithms of brightness end at.
const DARKEST: f32 = 4.0 / 255.0;

/// Which lens distortion images have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Lenses {
    /// What the clip states, unless the returns say that the images were rectified before.
    #[default]
    Auto,
    /// What the clip states.
    Stated,
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

/// The clip, its lens distortion taken away where the input images that `selection` names say that it is not theirs; then with what they say.
///
/// # Errors
/// Whatever is wrong with the selection, an image or a sweep.
pub fn with_fitting_lenses(dir: ClipDir, selection: &Selection) -> Result<(ClipDir, Option<LensFinding>)> {
    let frames = selection.frames(dir.clip())?.input;
    let wanted = |name: &str| selection.cameras.as_ref().is_none_or(|names| names.iter().any(|other| other == name));
    let mut cameras: Vec<String> = Vec::new();
    let mut size = None;
    for record in frames.iter().flat_map(|&frame| &dir.clip().frames[frame].cameras) {
        let camera = &record.camera;
        let distorted =
            matches!(camera.distortion, Some(Distortion::BrownConrady(lens)) if lens.iter().any(|&k| k != 0.0));
        if distorted && wanted(&camera.name) && !cameras.contains(&camera.name) {
            cameras.push(camera.name.clone());
            size = size.or(Some([camera.height, camera.width].map(|side| usize::try_from(side).unwrap_or(1))));
        }
    }
    let Some([height, width]) = size else { return Ok((dir, None)) };
    let factor = (width / WIDTH).max(1);
    let first = (frames.len().saturating_sub(FRAMES)) / 2;
    let frames: Vec<usize> = frames.into_iter().skip(first).take(FRAMES).collect();
    let frame = ClipFrame::of(dir.clip(), frames[0]);
    let cloud = points::aggregate(&dir, &frames, &frame)?;
    let small = Selection {
        cameras: Some(cameras.clone()),
        frames: Some(frames),
        hold_out: Vec::new(),
        image_size: Some(ImageSize { height: (height / factor).max(1), width: width / factor }),
    };
    let stated = load_views(&dir, &small, Role::Input, &frame, &|| ())?;
    let plain = dir.clone().without_distortion();
    let without = load_views(&plain, &small, Role::Input, &frame, &|| ())?;
    let pairs = pairs(&cloud, &stated, &without);
    let total: f64 = pairs.iter().map(|pair| pair.count).sum();
    let mean = |k: usize| pairs.iter().map(|pair| pair.count * pair.unexplained[k]).sum::<f64>() / total;
    let agreed: f64 = pairs.iter().filter(|p| p.unexplained[1] < p.unexplained[0]).map(|pair| pair.count).sum();
    let unexplained = [mean(0), mean(1)];
    let believed = total > 0.0 && unexplained[1] < LESS * unexplained[0] && agreed >= MOST * total;
    Ok(if believed { (plain, Some(LensFinding { cameras, unexplained })) } else { (dir, None) })
}

/// Every image with the next of its camera, and with those beside it.
fn pairs(cloud: &PointCloud, stated: &[View], without: &[View]) -> Vec<Pair> {
    let next = |i: usize| {
        let later = |&j: &usize| stated[j].camera == stated[i].camera && stated[j].frame > stated[i].frame;
        (0..stated.len()).filter(later).min_by_key(|&j| stated[j].frame)
    };
    let beside = |i: usize| (i + 1..stated.len()).filter(move |&j| stated[j].frame == stated[i].frame);
    let all: Vec<[usize; 2]> =
        (0..stated.len()).flat_map(|i| next(i).into_iter().chain(beside(i)).map(move |j| [i, j])).collect();
    let grid = |view: &View| DepthGrid::new(view.pinhole.width, view.pinhole.height, &view.depth_samples);
    let grids: Vec<DepthGrid> = stated.par_iter().map(grid).collect();
    all.par_iter().filter_map(|&both| pair(cloud, both, [stated, without], &grids)).collect()
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

/// Pearson's correlation of pairs; 0 where one of them is always the same.
fn correlation(pairs: impl Iterator<Item = [f64; 2]> + Clone) -> f64 {
    let count = pairs.clone().count() as f64;
    let mean = [0, 1].map(|k| pairs.clone().map(|pair| pair[k]).sum::<f64>() / count);
    let moment = |a: usize, b: usize| pairs.clone().map(|pair| (pair[a] - mean[a]) * (pair[b] - mean[b])).sum::<f64>();
    let scale = (moment(0, 0) * moment(1, 1)).sqrt();
    if scale > 0.0 { moment(0, 1) / scale } else { 0.0 }
}
