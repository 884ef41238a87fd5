//! Photometry: what the cameras of a rig make of the same light, so that they agree.
//!
//! Exposure, white balance, tone and vignetting differ from camera to camera. Colours of Gaussians live in one common space, which is the
//! reference camera's but for a factor that leaves room for what it clips. [`Photometry::estimate`] finds each image's [`Response`]; images
//! are brought to common colours on the way in, and what is drawn is shown through the response of its camera on the way out.

mod fit;
mod grey;
mod observations;
#[cfg(test)]
mod tests;

use lgs_formats::casts::to_f32;
use serde::{Deserialize, Serialize};

pub(crate) use grey::put_aside;

use crate::{
    views::{Response, View},
    words::Words,
};
use fit::{Fit, Judged, Shown, fit};
use observations::{Observations, observe};

/// Places of several cameras that say anything of them.
const FEWEST_PLACES: usize = 50;
/// A response that changes colours by less than this share, in the mean over what its camera shows of shared places, is none ...
const LEAST_CHANGE: f64 = 0.02;
/// ... and so are all where they leave more than this share of the cameras' difference, ...
const LEAST_GAIN: f64 = 0.8;
/// ... or of that of a camera's own images.
const LEAST_GAIN_WITHIN: f64 = 0.95;
/// What is brighter than all but this share of the pixels may be clipped in the common space.
const CLIPPED: f64 = 1e-3;
/// Pixels of an image that are looked at for that: every so many.
const STRIDE: usize = 13;

/// Whether cameras are brought to common colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Colours {
    /// Where cameras of a rig show the same places in other colours.
    #[default]
    Auto,
    /// Never: every image as its camera took it.
    AsTaken,
}

impl Words for Colours {
    const WORDS: &[(&str, Self, &str)] = &[
        ("auto", Self::Auto, "Where cameras of a rig show the same places in other colours"),
        ("as-taken", Self::AsTaken, "Never: every image as its camera took it"),
    ];
}

/// How images are compared with a scene: what an input image's camera made of light holds for every other image that it takes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CommonColours {
    /// The responses of cameras that disagree; `None` where they agree.
    pub photometry: Option<Photometry>,
    /// Names of the grey cameras that stepped aside.
    pub grey: Vec<String>,
}

impl CommonColours {
    /// Makes the images of these views, as the cameras took them, such of common colours.
    pub fn apply(&self, views: &mut [View]) {
        for view in views {
            if self.grey.contains(&view.camera) {
                view.response = Some(Response::GREY);
            } else if let Some(photometry) = &self.photometry {
                view.make_common(photometry.response(&view.camera, view.pinhole.time));
            }
        }
    }

    /// What is told of it, for people.
    pub fn in_words(&self) -> impl Iterator<Item = String> {
        let grey = (!self.grey.is_empty())
            .then(|| format!("{} grey; nothing is taken from where colour cameras see the same", self.grey.join(", ")));
        self.photometry.as_ref().map(Photometry::in_words).into_iter().chain(grey)
    }
}

/// The responses of the images of a clip.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Photometry {
    /// Name of the camera whose colours the common ones are.
    pub reference: String,
    /// Common colours times this are those of the reference camera: more than 1 where others show what it clips.
    pub brightness: f32,
    /// Typical difference of the colours of one place, as a share: as they are, and by their responses.
    pub differences: [f32; 2],
    /// Each input image's, in the order of the views.
    pub images: Vec<ImageResponse>,
}

/// The response of one image.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImageResponse {
    /// Index of the frame in the clip.
    pub frame: usize,
    /// Name of the camera.
    pub camera: String,
    /// Seconds since the clip's time zero.
    #[serde(skip)]
    pub time: f32,
    /// How it shows common colours.
    #[serde(flatten)]
    pub response: Response,
}

impl Photometry {
    /// The responses under which `views` agree: of cameras that disagree in the colours of the camera `reference` or else of the first;
    /// else what vignetting and single images' gains change. `None` where they agree as they are, or share too little to tell.
    pub fn estimate(views: &[View], reference: Option<&str>) -> Option<Self> {
        let mut names: Vec<&str> = Vec::new();
        for view in views {
            if !names.contains(&view.camera.as_str()) {
                names.push(&view.camera);
            }
        }
        let place = |name: &str| names.iter().position(|other| *other == name);
        let cameras: Vec<usize> = views.iter().map(|view| place(&view.camera).unwrap_or(0)).collect();
        let reference = reference.and_then(place).unwrap_or(0);
        let observed = observe(views);
        let fitted = |observed: &Observations, judged| fit(observed, &cameras, names.len(), reference, judged);
        let several = (names.len() > 1).then(|| fitted(&observed, Judged::BetweenCameras));
        let (mut images, brightness, errors) = if let Some(between) = several.filter(|fit| tells(fit, LEAST_GAIN)) {
            let images = images(views, &cameras, &between, false);
            let brightness = brightest(views, &images);
            (images, brightness, between.errors)
        } else {
            let within = fitted(&observed.of_light(), Judged::All);
            if !tells(&within, LEAST_GAIN_WITHIN) {
                return None;
            }
            (images(views, &cameras, &within, true), 1.0, within.errors)
        };
        for image in &mut images {
            image.response.gain = image.response.gain.map(|gain| gain * brightness);
        }
        let differences = errors.map(to_f32);
        Some(Self { reference: names[reference].to_owned(), brightness, differences, images })
    }

    /// How a camera shows common colours at a moment: as its input images nearest in time do, in between by time; as the reference camera
    /// does for one that has none.
    pub fn response(&self, camera: &str, time: f32) -> Response {
        let own = || self.images.iter().filter(|image| image.camera == camera);
        let before = own().filter(|image| image.time <= time).max_by(|a, b| a.time.total_cmp(&b.time));
        let after = own().filter(|image| image.time >= time).min_by(|a, b| a.time.total_cmp(&b.time));
        match (before, after) {
            (Some(before), Some(after)) if after.time > before.time => {
                let share = (time - before.time) / (after.time - before.time);
                let gain = |k: usize| {
                    let [from, to] = [before, after].map(|image| image.response.gain[k].ln());
                    (from + share * (to - from)).exp()
                };
                Response { gain: std::array::from_fn(gain), ..before.response }
            }
            (Some(near), _) | (None, Some(near)) => near.response,
            (None, None) => self.plain(),
        }
    }

    /// How the reference camera would show common colours without vignetting: what files and films hold.
    pub const fn plain(&self) -> Response {
        Response { gain: [self.brightness; 3], ..Response::IDENTITY }
    }

    /// What was found, for people.
    pub fn in_words(&self) -> String {
        let [before, after] = self.differences.map(|share| 100.0 * share);
        let brought = if self.images.iter().all(|image| image.response.shoulder) {
            "freed from vignetting and changes of exposure".to_owned()
        } else {
            format!("brought to the colours of {}", self.reference)
        };
        format!("{brought}: the same places differed by {before:.1} %, now by {after:.1} %")
    }
}

/// Whether responses change enough, and leave no more than this share of what places differ by.
fn tells(found: &Fit, share: f64) -> bool {
    let [before, after] = found.errors;
    let changed = found.changes.iter().any(|&change| change > LEAST_CHANGE);
    found.judged >= FEWEST_PLACES && changed && after <= share * before
}

fn images(views: &[View], cameras: &[usize], found: &Fit, shoulder: bool) -> Vec<ImageResponse> {
    let image = |((view, &camera), &exposure): ((&View, &usize), &f64)| ImageResponse {
        frame: view.frame,
        camera: view.camera.clone(),
        time: view.pinhole.time,
        response: Response { shoulder, ..found.cameras[camera].response(exposure) },
    };
    views.iter().zip(cameras).zip(&found.exposures).map(image).collect()
}

impl Shown {
    fn response(&self, exposure: f64) -> Response {
        Response {
            gain: self.offset.map(|offset| to_f32(((offset + exposure) / self.slope).exp())),
            tone: to_f32(self.slope),
            vignetting: self.vignetting.map(|term| to_f32(-term / self.slope)),
            grey: false,
            shoulder: false,
        }
    }
}

/// What the brightest common colours are, at least 1.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a length")]
fn brightest(views: &[View], images: &[ImageResponse]) -> f32 {
    let common_colours = |(view, image): (&View, &ImageResponse)| {
        let mut changed = view.image.data.clone();
        image.response.to_common(&mut changed, &view.pinhole);
        changed.into_iter().step_by(STRIDE)
    };
    let mut all: Vec<f32> = views.iter().zip(images).flat_map(common_colours).collect();
    all.sort_unstable_by(f32::total_cmp);
    let place = (all.len() as f64 * (1.0 - CLIPPED)) as usize;
    all.get(place).copied().unwrap_or(1.0).max(1.0)
}
