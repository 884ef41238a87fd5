//! Which clips are measured, and how each of them is read.

use std::{path::PathBuf, str::FromStr};

use lgs_engine::{
    error::EngineError,
    gaussians::motion::Motion,
    pipeline::{HoldOut, Opening},
    views::Selection,
};
use lgs_formats::{
    clip::Clip,
    clip_dir::{ClipDir, Needed},
    image::ImageSize,
    importers,
};
use serde::{Deserialize, Serialize};

/// Most frames of a clip whose files are looked for one by one.
const MAX_FRAMES: usize = 1_000_000;

/// A clip and how it is read.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// Its directory.
    pub dir: PathBuf,
    /// Names of the cameras; `None` for all.
    pub cameras: Option<Vec<String>>,
    /// Which frames are held out.
    pub hold_out: HoldOut,
    /// Size to which every image is brought; `None` for its own.
    pub image_size: Option<ImageSize>,
    /// At most so many frames from the first on; `None` for all.
    pub num_frames: Option<usize>,
    /// At most so many cameras, in the clip's order; `None` for all.
    pub num_cameras: Option<usize>,
    /// Where the initial velocities come from.
    pub motion: Motion,
}

/// A choice as it is recorded: what decides the result, without where the clip lies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedChoice {
    cameras: Option<Vec<String>>,
    hold_out: String,
    image_size: Option<[usize; 2]>,
    num_frames: Option<usize>,
    num_cameras: Option<usize>,
    /// Records from before there was a choice had none.
    #[serde(default = "no_motion")]
    motion: Motion,
}

const fn no_motion() -> Motion {
    Motion::None
}

impl Choice {
    /// The clip in `dir` as it is, its odd frames held out.
    pub fn new(dir: PathBuf) -> Self {
        Self {
            dir,
            cameras: None,
            hold_out: HoldOut::Odd,
            image_size: None,
            num_frames: None,
            num_cameras: None,
            motion: Motion::default(),
        }
    }

    /// How its clip is opened.
    ///
    /// # Errors
    /// Frames that the clip does not have.
    pub fn opening(&self, clip: &Clip) -> Result<Opening, EngineError> {
        let num_frames = clip.frames.len().min(self.num_frames.unwrap_or(usize::MAX));
        let chosen: Vec<usize> = (0..num_frames).collect();
        let hold_out = self.hold_out.indices(num_frames, Some(&chosen))?;
        let first_cameras = |count: usize| {
            let records = clip.frames.first().map(|frame| frame.cameras.as_slice()).unwrap_or_default();
            records.iter().take(count).map(|record| record.camera.name.clone()).collect()
        };
        let cameras = self.cameras.clone().or_else(|| self.num_cameras.map(first_cameras));
        let selection = Selection { cameras, frames: Some(chosen), hold_out, image_size: self.image_size };
        Ok(Opening { motion: self.motion, ..Opening::of(selection) })
    }

    /// What is recorded of it.
    pub fn recorded(&self) -> RecordedChoice {
        RecordedChoice {
            cameras: self.cameras.clone(),
            hold_out: self.hold_out.to_string(),
            image_size: self.image_size.map(|size| [size.height, size.width]),
            num_frames: self.num_frames,
            num_cameras: self.num_cameras,
            motion: self.motion,
        }
    }
}

/// The clip of a choice.
///
/// # Errors
/// Whatever is wrong with it.
pub fn open(choice: &Choice) -> lgs_formats::error::Result<ClipDir> {
    let frames = choice.num_frames.map(|count| (0..count.min(MAX_FRAMES)).collect());
    importers::open_part(&choice.dir, &Needed { frames, cameras: choice.cameras.clone() })
}

impl FromStr for Choice {
    type Err = String;

    /// `DIR[;hold-out=RULE][;cameras=A,B][;image-size=HxW][;frames=N][;motion=registered|none]`.
    fn from_str(text: &str) -> Result<Self, String> {
        let mut parts = text.split(';');
        let dir = parts.next().filter(|dir| !dir.is_empty()).ok_or("expected a clip directory, found nothing")?;
        let mut choice = Self::new(dir.into());
        for part in parts {
            match part.split_once('=') {
                Some(("hold-out", rule)) => choice.hold_out = rule.parse()?,
                Some(("cameras", names)) => choice.cameras = Some(names.split(',').map(str::to_owned).collect()),
                Some(("image-size", size)) => {
                    choice.image_size = Some(size.parse().map_err(|e| format!("image-size: {e}"))?);
                }
                Some(("frames", count)) => {
                    let count = count.parse().ok().filter(|count| (1..=1_000_000).contains(count));
                    choice.num_frames = Some(count.ok_or("frames: expected a number from 1 to 1000000")?);
                }
                Some(("motion", "registered")) => choice.motion = Motion::Registered,
                Some(("motion", "none")) => choice.motion = Motion::None,
                _ => {
                    return Err(format!(
                        "expected hold-out=, cameras=, image-size=, frames= or motion=, found {part:?}"
                    ));
                }
            }
        }
        Ok(choice)
    }
}

#[cfg(test)]
mod tests {
    use super::{Choice, HoldOut, Motion};

    #[test]
    fn a_clip_and_its_options_are_read() {
        let plain: Choice = "a/b".parse().unwrap();
        assert_eq!(plain, Choice::new("a/b".into()));
        let all: Choice = "c;hold-out=1;cameras=A,B;image-size=304x484;frames=5;motion=none".parse().unwrap();
        assert_eq!((all.hold_out, all.num_frames), (HoldOut::List(vec![1]), Some(5)));
        assert_eq!((plain.motion, all.motion), (Motion::Registered, Motion::None));
        assert_eq!(all.cameras, Some(vec!["A".to_owned(), "B".to_owned()]));
        assert_eq!(all.image_size.map(|size| [size.height, size.width]), Some([304, 484]));
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        for text in
            ["", ";frames=3", "c;frames=0", "c;hold-out=even", "c;image-size=3", "c;size=3x4", "c;motion=fast", "c;"]
        {
            assert!(text.parse::<Choice>().is_err(), "{text}");
        }
    }
}
