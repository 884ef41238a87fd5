//! Photometry: what the cameras of a rig make of the same light, so that they agree.
//!
//! Exposure, white balance, tone and vignetting differ from camera to camera. Colours of Gaussians live in one common space, which is the
//! reference camera's but for a factor that leaves room for what it clips. [`Photometry::estimate`] finds each image's [`Response`]; images
//! are brought to common colours on the way in, and what is drawn is shown through the response of its camera on the way out.

mod fit;
mod lenses;
mod observations;

use serde::Serialize;

use crate::views::{Response, View, to_f32};

pub use lenses::{LensFinding, with_fitting_lenses};

use fit::{Shown, fit};
use observations::observe;

/// Places that cameras must share before anything is said of them.
const FEWEST_PLACES: usize = 50;
/// A camera whose typical colours change by less than this share is left as it is.
const LEAST_CHANGE: f64 = 0.02;
/// What is brighter than all but this share of the pixels may be clipped in the common space.
const CLIPPED: f64 = 1e-3;
/// Pixels of an image that are looked at for that: every so many.
const STRIDE: usize = 13;

/// The responses of the images of a clip.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Photometry {
    /// Name of the camera whose colours the common ones are; `None` where the images are taken as they are.
    pub reference: Option<String>,
    /// Common colours times this are those of the reference camera; 1 where it clips nothing that others show.
    pub brightness: f32,
    /// Each input image's, in the order of the views.
    pub images: Vec<ImageResponse>,
    /// Typical difference of two cameras' colours of one place, as a share: as they are, and by their responses.
    pub differences: Option<[f32; 2]>,
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
    /// The images as they are.
    pub fn none() -> Self {
        Self { reference: None, brightness: 1.0, images: Vec::new(), differences: None }
    }

    /// The responses under which `views` agree; [`Photometry::none`] where they do as they are, or where they share too little to tell.
    pub fn estimate(views: &[View], reference: Option<&str>) -> Self {
        let mut names: Vec<&str> = Vec::new();
        for view in views {
            if !names.contains(&view.camera.as_str()) {
                names.push(&view.camera);
            }
        }
        let camera_of = |view: &View| names.iter().position(|name| *name == view.camera).unwrap_or(0);
        let cameras: Vec<usize> = views.iter().map(camera_of).collect();
        let reference = reference.and_then(|name| names.iter().position(|other| *other == name)).unwrap_or(0);
        if names.len() < 2 {
            return Self::none();
        }
        let observed = observe(views);
        let found = fit(&observed, &cameras, names.len(), reference);
        if std::env::var_os("LGS_PHOTO").is_some() {
            eprintln!("{} places {:?}", observed.places.len(), found);
        }
        let images = views.iter().zip(&cameras).zip(&found.exposures);
        let mut images: Vec<ImageResponse> = images
            .map(|((view, &camera), &exposure)| ImageResponse {
                frame: view.frame,
                camera: view.camera.clone(),
                time: view.pinhole.time,
                response: found.cameras[camera].response(exposure),
            })
            .collect();
        let brightness = brightest(views, &images);
        for image in &mut images {
            image.response.gain = image.response.gain.map(|gain| gain * brightness);
        }
        Self {
            reference: Some(names[reference].to_owned()),
            brightness,
            images,
            differences: Some(found.errors.map(to_f32)),
        }
    }

    /// Nothing: the images of these views, as the cameras took them, become such of common colours.
    pub fn apply(&self, views: &mut [View]) {
        for view in views {
            if let Some(response) = self.response(&view.camera, view.pinhole.time) {
                view.make_common(response);
            }
        }
    }

    /// How a camera shows common colours at a moment: as its input images nearest in time do, in between by time. `None` where it
    /// shows them as they are.
    pub fn response(&self, camera: &str, time: f32) -> Option<Response> {
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
                Some(Response { gain: std::array::from_fn(gain), ..before.response })
            }
            (Some(near), _) | (None, Some(near)) => Some(near.response),
            (None, None) => (!self.images.is_empty()).then(|| Response { gain: [self.brightness; 3], ..Response::IDENTITY }),
        }
    }
}

impl Shown {
    fn response(&self, exposure: f64) -> Response {
        Response {
            gain: self.offset.map(|offset| to_f32(((offset + exposure) / self.slope).exp())),
            tone: to_f32(self.slope),
            vignetting: self.vignetting.map(|term| to_f32(-term / self.slope)),
        }
    }
}

/// What the brightest common colours are, at least 1.
fn brightest(views: &[View], images: &[ImageResponse]) -> f32 {
    let of = |(view, image): (&View, &ImageResponse)| {
        let mut changed = view.image.data.clone();
        image.response.to_common(&mut changed, &view.pinhole);
        changed.into_iter().step_by(STRIDE)
    };
    let mut all: Vec<f32> = views.iter().zip(images).flat_map(of).collect();
    all.sort_unstable_by(f32::total_cmp);
    let place = (all.len() as f64 * (1.0 - CLIPPED)) as usize;
    all.get(place).copied().unwrap_or(1.0).max(1.0)
}
