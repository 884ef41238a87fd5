//! Clips that training reads, and the frames of them that it may.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use lgs_engine::{error::EngineError, pipeline::HoldOut, views::Selection};
use lgs_formats::{clip_dir::ClipDir, error::FormatError, image::ImageSize};

use crate::{
    error::{Result, TrainError},
    scenes::rng::Rng,
};

/// Name of the file that makes a directory a clip.
const CLIP_FILE: &str = "clip.json";
/// Frames of a draw: inputs at its even places, targets at its odd ones.
const WINDOWS: [usize; 5] = [2, 3, 5, 5, 7];

/// Factors by which images shrink.
const SCALES: [f64; 2] = [0.45, 0.8];

/// A clip and the frames of it that training may read.
#[derive(Debug)]
pub struct TrainingClip {
    dir: Arc<ClipDir>,
    allowed: Vec<usize>,
}

/// What one step reads of a clip. There is no other way to one than [`TrainingClip::draw`].
#[derive(Debug)]
pub struct Draw<'a> {
    clip: &'a TrainingClip,
    selection: Selection,
}

impl TrainingClip {
    /// The clip in `dir`, of which the frames of `hold_out` are never read.
    ///
    /// # Errors
    /// Whatever is wrong with the clip; a rule that no frame meets, or that leaves no frame.
    pub fn open(dir: &Path, hold_out: &HoldOut) -> Result<Self> {
        let dir = Arc::new(ClipDir::open(dir)?);
        let num_frames = dir.clip().frames.len();
        let held_out = hold_out.indices(num_frames, None)?;
        let selection = Selection { hold_out: held_out, ..Selection::default() };
        Ok(Self { allowed: selection.frames(dir.clip())?.input, dir })
    }

    /// What tells the clip from others.
    pub fn identity(&self) -> String {
        let clip = self.dir.clip();
        format!("{} ({})", clip.name, clip.source)
    }

    /// A window of frames and some cameras.
    ///
    /// At most `max_views` input views; images keep their size times a factor of 0.45 to 1.
    ///
    /// # Errors
    /// [`EngineError::Leak`] when a frame that is held out was drawn.
    pub(crate) fn draw(&self, rng: &mut Rng, max_views: usize) -> Result<Draw<'_>> {
        let longest = WINDOWS.into_iter().rev().find(|&n| n <= self.allowed.len()).unwrap_or(1);
        let length = rng.pick(&WINDOWS).min(longest);
        let start = rng.index(self.allowed.len() - length + 1);
        let window = &self.allowed[start..start + length];
        let hold_out: Vec<usize> = window.iter().copied().skip(1).step_by(2).collect();
        let names: Vec<String> =
            self.dir.clip().frames[window[0]].cameras.iter().map(|record| record.camera.name.clone()).collect();
        let num_inputs = length - hold_out.len();
        let most = (max_views / num_inputs).clamp(1, names.len().max(1));
        let count = rng.between(1, most);
        let mut cameras = names;
        while cameras.len() > count {
            cameras.remove(rng.index(cameras.len()));
        }
        let selection = Selection {
            cameras: Some(cameras),
            frames: Some(window.to_vec()),
            hold_out,
            image_size: self.image_size(window[0], rng.uniform(SCALES[0], SCALES[1])),
        };
        if let Some(&frame) = window.iter().find(|frame| !self.allowed.contains(frame)) {
            return Err(EngineError::Leak { frame }.into());
        }
        Ok(Draw { clip: self, selection })
    }

    fn image_size(&self, frame: usize, factor: f64) -> Option<ImageSize> {
        let camera = &self.dir.clip().frames[frame].cameras.first()?.camera;
        let scaled = |side: u32| crate::scenes::maths::count(f64::from(side) * factor).max(16);
        Some(ImageSize { height: scaled(camera.height), width: scaled(camera.width) })
    }
}

impl Draw<'_> {
    /// The clip's directory.
    pub fn dir(&self) -> &Arc<ClipDir> {
        &self.clip.dir
    }

    /// The frames that training may read.
    pub(crate) fn allowed(&self) -> &[usize] {
        &self.clip.allowed
    }

    /// Frames and cameras: its inputs are what the network is given, what it holds out are targets, which only the loss reads.
    pub fn selection(&self) -> &Selection {
        &self.selection
    }
}

/// The clip directories at `path`: itself, or those in it, in the order of their names.
///
/// # Errors
/// When there is none, or the directory cannot be read.
pub fn find(path: &Path) -> Result<Vec<PathBuf>> {
    if path.join(CLIP_FILE).is_file() {
        return Ok(vec![path.to_owned()]);
    }
    let failed = |source| FormatError::io(path, "read", source);
    let mut found = Vec::new();
    for entry in std::fs::read_dir(path).map_err(failed)? {
        let inner = entry.map_err(failed)?.path();
        if inner.join(CLIP_FILE).is_file() {
            found.push(inner);
        }
    }
    found.sort();
    if found.is_empty() {
        let expected = format!("a directory with {CLIP_FILE}, or one of such directories");
        return Err(TrainError::config(path.display().to_string(), expected, "none"));
    }
    Ok(found)
}
