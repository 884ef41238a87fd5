//! Calibration: what a clip states of its cameras, where its own returns and images say otherwise.
//!
//! What two images show of the same returns is the more alike the better their lenses and mounts are known. That needs no pattern and no second
//! drive, and tells of what no user looks at: a lens distortion stated for images that were rectified, a camera turned by a fifth of a degree.

mod alignment;
mod front;
mod lenses;
mod mounts;
mod successive;
#[cfg(test)]
mod tests;

use lgs_formats::{
    clip::{CameraRecord, Frame},
    clip_dir::ClipDir,
    image::ImageSize,
};
use serde::{Deserialize, Serialize};

pub use lenses::{LensFinding, Lenses};
pub use mounts::{Mount, MountFinding};
use successive::Asked;
pub use successive::CameraFinding;

use crate::{
    error::Result,
    points::{self, PointCloud},
    views::{ClipFrame, Role, Selection, View, load_views},
    words::Words,
};

/// Images that are looked at, and the fewest and the most frames of them.
const IMAGES: usize = 30;
const FRAMES: (usize, usize) = (5, 7);
/// Width to which images are reduced by a whole factor, at least, pixels.
const WIDTH: usize = 640;

/// Where cameras are mounted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mounts {
    /// Where the clip states, unless what they show of the same returns says that they are turned or moved against each other.
    #[default]
    Auto,
    /// Where the clip states.
    Stated,
}

impl Words for Mounts {
    const WORDS: &[(&str, Self, &str)] = &[
        (
            "auto",
            Self::Auto,
            "Where the clip states, unless what they show of the same returns says that they are turned or moved against each other",
        ),
        ("stated", Self::Stated, "Where the clip states"),
    ];
}

/// When images are exposed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shutters {
    /// When the clip states; of a camera of which it states nothing, as its images one after the other tell.
    #[default]
    Auto,
    /// When the clip states.
    Stated,
}

impl Words for Shutters {
    const WORDS: &[(&str, Self, &str)] = &[
        (
            "auto",
            Self::Auto,
            "When the clip states; of a camera of which it states no readout, as its images one after the other tell",
        ),
        ("stated", Self::Stated, "When the clip states"),
    ];
}

/// Which statements of a clip are believed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Believed<'a> {
    /// Those on lenses.
    pub lenses: Lenses,
    /// Those on mounts.
    pub mounts: Mounts,
    /// Those on the moments at which images are exposed.
    pub shutters: Shutters,
    /// The camera against which the others are mounted; `None` for the one against which they are least off.
    pub reference: Option<&'a str>,
}

/// What was found to be otherwise than stated.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Findings {
    /// Lenses.
    pub lenses: Option<LensFinding>,
    /// Mounts and shutters of single cameras, by their own images.
    pub cameras: Vec<CameraFinding>,
    /// Mounts of the cameras of a rig against one another.
    pub mounts: Option<MountFinding>,
}

/// What is otherwise than stated, as the input images which `selection` names tell it, and the clip as it is then; `None` where it stays.
///
/// # Errors
/// Whatever is wrong with the selection, an image or a sweep.
pub fn calibrated(dir: &ClipDir, selection: &Selection, believed: Believed<'_>) -> Result<(Option<ClipDir>, Findings)> {
    let mut findings = Findings::default();
    let frames = selection.frames(dir.clip())?.input;
    let distorted = match believed.lenses {
        Lenses::Auto => lenses::distorted(dir, &frames, selection),
        Lenses::Stated => Vec::new(),
    };
    let separate = mounts::separate(dir, &frames, selection);
    let asked = |camera: &String| Asked {
        mount: believed.mounts == Mounts::Auto,
        readout: believed.shutters == Shutters::Auto && !states_readout(dir, camera),
    };
    let is_asked = |camera: &&String| asked(camera) != Asked { mount: false, readout: false };
    let alone: Vec<String> = separate
        .iter()
        .filter(is_asked)
        .filter(|camera| successive::is_carried(dir.clip(), &middle(&frames, separate.len()), camera))
        .cloned()
        .collect();
    let several = believed.mounts == Mounts::Auto && separate.len() > 1;
    let compared =
        |name: &String| distorted.contains(name) || alone.contains(name) || several && separate.contains(name);
    let cameras = cameras_of(dir, &frames, selection, &|_, record| compared(&record.camera.name));
    let Some(sample) = Sample::new(dir, &cameras, &frames)? else { return Ok((None, findings)) };
    let mut views = sample.views(dir)?;
    let mut changed: Option<ClipDir> = None;
    if !distorted.is_empty() {
        let plain = dir.clone().without_distortion();
        let without = sample.views(&plain)?;
        findings.lenses = lenses::rectified(&sample.cloud, &views, &without, &distorted);
        if findings.lenses.is_some() {
            (changed, views) = (Some(plain), without);
        }
    }
    let told = |camera: &String| {
        let clip = changed.as_ref().unwrap_or(dir).clip();
        successive::otherwise(clip, &sample.cloud, &views, camera, asked(camera))
    };
    findings.cameras = alone.iter().filter_map(told).collect();
    for found in &findings.cameras {
        let clip = changed.unwrap_or_else(|| dir.clone());
        let clip = clip.with_mount(&found.mount.camera, &found.mount.stated_from_found());
        changed =
            Some(found.readout.into_iter().fold(clip, |clip, readout| clip.with_readout(&found.mount.camera, readout)));
    }
    if several {
        if let Some(changed) = changed.as_ref().filter(|_| !findings.cameras.is_empty()) {
            views = sample.views(changed)?;
        }
        findings.mounts = mounts::otherwise(&sample.cloud, &views, &separate, believed.reference);
        for mount in findings.mounts.iter().flat_map(|found| &found.cameras) {
            changed =
                Some(changed.unwrap_or_else(|| dir.clone()).with_mount(&mount.camera, &mount.stated_from_found()));
        }
    }
    Ok((changed, findings))
}

/// Whether the clip says when images of a camera are exposed.
fn states_readout(dir: &ClipDir, camera: &str) -> bool {
    let mut records = dir.clip().frames.iter().flat_map(|frame| &frame.cameras);
    records.any(|record| record.camera.name == camera && record.camera.readout.is_some())
}

/// The frames in the middle that are looked at, of so many cameras.
fn middle(frames: &[usize], num_cameras: usize) -> Vec<usize> {
    let most = (IMAGES / num_cameras.max(1)).clamp(FRAMES.0, FRAMES.1);
    let skipped = frames.len().saturating_sub(most) / 2;
    frames.iter().copied().skip(skipped).take(most).collect()
}

/// The middle input frames of a clip, with small images of some cameras.
struct Sample {
    frame: ClipFrame,
    selection: Selection,
    cloud: PointCloud,
}

impl Sample {
    /// The middle ones of `frames` and the images that `cameras` took then, all of which are brought to the shape of the first; `None` where
    /// there are none.
    fn new(dir: &ClipDir, cameras: &[String], frames: &[usize]) -> Result<Option<Self>> {
        let all = frames.iter().flat_map(|&frame| &dir.clip().frames[frame].cameras);
        let Some(first) = all.map(|record| &record.camera).find(|camera| cameras.contains(&camera.name)) else {
            return Ok(None);
        };
        let [height, width] = [first.height, first.width].map(|side| usize::try_from(side).unwrap_or(1));
        let factor = (width / WIDTH).max(1);
        let frames = middle(frames, cameras.len());
        let frame = ClipFrame::of(dir.clip(), frames[0]);
        let mut cloud = points::aggregate(dir, &frames, &frame)?;
        points::tell_apart(&mut cloud, dir.clip(), &frame)?;
        let selection = Selection {
            cameras: Some(cameras.to_vec()),
            frames: Some(frames),
            hold_out: Vec::new(),
            image_size: Some(ImageSize { height: (height / factor).max(1), width: width / factor }),
        };
        Ok(Some(Self { frame, selection, cloud }))
    }

    /// The images, as `dir` says that they are.
    fn views(&self, dir: &ClipDir) -> Result<Vec<View>> {
        load_views(dir, &self.selection, Role::Input, &self.frame, &|| ())
    }
}

/// The cameras of some frames that `selection` names and `chosen` picks, in the order of the clip.
fn cameras_of(
    dir: &ClipDir,
    frames: &[usize],
    selection: &Selection,
    chosen: &dyn Fn(&Frame, &CameraRecord) -> bool,
) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for frame in frames.iter().map(|&frame| &dir.clip().frames[frame]) {
        for record in frame.cameras.iter().filter(|record| chosen(frame, record)) {
            let name = &record.camera.name;
            let wanted = selection.cameras.as_ref().is_none_or(|wanted| wanted.contains(name));
            if wanted && !names.contains(name) {
                names.push(name.clone());
            }
        }
    }
    names
}

/// Pearson's correlation of pairs; 0 where one of them is always the same.
fn correlation(pairs: impl Iterator<Item = [f64; 2]> + Clone) -> f64 {
    let count = pairs.clone().count() as f64;
    let mean = [0, 1].map(|k| pairs.clone().map(|pair| pair[k]).sum::<f64>() / count);
    let moment = |a: usize, b: usize| pairs.clone().map(|pair| (pair[a] - mean[a]) * (pair[b] - mean[b])).sum::<f64>();
    let scale = (moment(0, 0) * moment(1, 1)).sqrt();
    if scale > 0.0 { moment(0, 1) / scale } else { 0.0 }
}
