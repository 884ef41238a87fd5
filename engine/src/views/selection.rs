//! Which frames and cameras of a clip a run works on.

use std::collections::BTreeSet;

use lgs_formats::{clip::Clip, image::ImageSize};

use super::Role;
use crate::error::{EngineError, Result};

/// Cameras, frames and image size as the user asked for them; not yet checked against a clip.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// Names of cameras; `None` for all of them.
    pub cameras: Option<Vec<String>>,
    /// Indices of frames; `None` for all of them.
    pub frames: Option<Vec<usize>>,
    /// Indices of frames that the reconstruction must not see.
    pub hold_out: Vec<usize>,
    /// Size to which every image is brought; `None` for its own.
    pub image_size: Option<ImageSize>,
}

/// Frames of a clip by what they are for, ascending.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SelectedFrames {
    /// Frames whose images and sweeps the reconstruction reads; at least one.
    pub input: Vec<usize>,
    /// Frames that only the figures read.
    pub held_out: Vec<usize>,
}

/// One image to load.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SelectedImage {
    /// Index of the frame in the clip.
    pub(super) frame: usize,
    /// Index of the camera in the frame.
    pub(super) camera: usize,
    /// What the image is for.
    pub(super) role: Role,
}

impl Selection {
    /// The frames of `clip` that take part.
    ///
    /// # Errors
    /// [`EngineError::Setting`] for a frame that the clip does not have, one that is named twice, a held-out frame that
    /// is not selected, or a hold-out that leaves no input frame.
    pub fn frames(&self, clip: &Clip) -> Result<SelectedFrames> {
        let num_frames = clip.frames.len();
        let chosen = match &self.frames {
            Some(frames) => distinct("frames", frames, num_frames)?,
            None => (0..num_frames).collect(),
        };
        let held_out = distinct("hold-out", &self.hold_out, num_frames)?;
        if let Some(stranger) = held_out.iter().find(|frame| !chosen.contains(frame)) {
            let expected = format!("frames among those of `frames` ({})", list(&chosen));
            return Err(setting("hold-out", expected, stranger.to_string()));
        }
        let input: Vec<usize> = chosen.difference(&held_out).copied().collect();
        if input.is_empty() {
            let found = format!("{} of {} frames held out", held_out.len(), chosen.len());
            return Err(setting("hold-out", "at least one frame left as input".to_owned(), found));
        }
        Ok(SelectedFrames { input, held_out: held_out.into_iter().collect() })
    }

    /// The number of images of one role that the selection holds.
    ///
    /// # Errors
    /// As [`Selection::frames`]; [`EngineError::Setting`] for a camera that no selected frame has or that is named twice,
    /// and for a selection without any input image.
    pub fn num_images(&self, clip: &Clip, role: Role) -> Result<usize> {
        Ok(self.images(clip)?.iter().filter(|image| image.role == role).count())
    }

    /// `[H, W]` of every image that the selection holds, as it will be loaded.
    ///
    /// # Errors
    /// Those of [`Selection::num_images`].
    pub fn sizes(&self, clip: &Clip) -> Result<Vec<[usize; 2]>> {
        let own = |image: &SelectedImage| {
            let camera = &clip.frames[image.frame].cameras[image.camera].camera;
            [camera.height, camera.width].map(|side| usize::try_from(side).unwrap_or(usize::MAX))
        };
        let size = |image: &SelectedImage| self.image_size.map_or_else(|| own(image), |size| [size.height, size.width]);
        Ok(self.images(clip)?.iter().map(size).collect())
    }

    /// The images to load: frame by frame, cameras in the clip's order.
    ///
    /// # Errors
    /// Those of [`Selection::frames`], and [`EngineError::Setting`] for a camera that no selected frame has or that is
    /// named twice, and for a selection without any input image.
    pub(super) fn images(&self, clip: &Clip) -> Result<Vec<SelectedImage>> {
        let frames = self.frames(clip)?;
        let roles = frames.input.iter().map(|&f| (f, Role::Input));
        let mut all: Vec<_> = roles.chain(frames.held_out.iter().map(|&f| (f, Role::HeldOut))).collect();
        all.sort_unstable_by_key(|&(frame, _)| frame);
        if let Some(names) = &self.cameras {
            check_cameras(names, clip, &all)?;
        }
        let wanted = |name: &String| self.cameras.as_ref().is_none_or(|names| names.contains(name));
        let images: Vec<SelectedImage> = all
            .iter()
            .flat_map(|&(frame, role)| {
                let cameras = clip.frames[frame].cameras.iter().enumerate();
                let chosen = cameras.filter(|(_, record)| wanted(&record.camera.name));
                chosen.map(move |(camera, _)| SelectedImage { frame, camera, role })
            })
            .collect();
        if images.iter().any(|image| image.role == Role::Input) {
            return Ok(images);
        }
        let expected = "an image in an input frame of the clip".to_owned();
        let setting_name = if self.cameras.is_some() { "cameras" } else { "frames" };
        Err(setting(setting_name, expected, format!("none in {}", list(&frames.input))))
    }
}

fn check_cameras(names: &[String], clip: &Clip, frames: &[(usize, Role)]) -> Result<()> {
    let of_frame = |&(frame, _): &(usize, Role)| clip.frames[frame].cameras.iter().map(|record| &record.camera.name);
    let known: BTreeSet<&String> = frames.iter().flat_map(of_frame).collect();
    for (i, name) in names.iter().enumerate() {
        if !known.contains(name) {
            return Err(setting("cameras", format!("cameras among {}", list(&known)), name.clone()));
        }
        if names[..i].contains(name) {
            return Err(setting("cameras", "every camera once".to_owned(), format!("{name} twice")));
        }
    }
    if names.is_empty() {
        return Err(setting("cameras", "at least one camera".to_owned(), "none".to_owned()));
    }
    Ok(())
}

fn distinct(flag: &'static str, frames: &[usize], num_frames: usize) -> Result<BTreeSet<usize>> {
    let mut seen = BTreeSet::new();
    for &frame in frames {
        if frame >= num_frames {
            return Err(setting(flag, format!("frame indices below {num_frames}"), frame.to_string()));
        }
        if !seen.insert(frame) {
            return Err(setting(flag, "every frame once".to_owned(), format!("{frame} twice")));
        }
    }
    Ok(seen)
}

fn setting(setting: &'static str, expected: String, found: String) -> EngineError {
    EngineError::Setting { setting, expected, found }
}

fn list<T: ToString>(items: impl IntoIterator<Item = T>) -> String {
    let items: Vec<String> = items.into_iter().map(|item| item.to_string()).collect();
    items.join(", ")
}
