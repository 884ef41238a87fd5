//! Drives, opened: once for how long they are, and one at a time for all of its snippets.

use std::sync::Arc;

use lgs_formats::{
    clip_dir::{ClipDir, Needed},
    error::{FormatError, Result},
    importers,
};

use super::{drives::Drive, protocol::Snippet};

/// Frames that are tried for one that can be read, when a drive is looked at.
const TRIED: usize = 8;

/// The number of frames of a drive, of which as little as possible is read.
///
/// # Errors
/// A drive of which none of the first frames can be read; what is wrong with the first one.
pub fn num_frames(drive: &Drive, cameras: Option<&[String]>) -> Result<usize> {
    let mut first: Option<FormatError> = None;
    for frame in 0..TRIED {
        let needed = Needed { frames: Some(vec![frame]), cameras: cameras.map(<[String]>::to_vec) };
        match importers::open_scene(&drive.path, drive.scene.as_deref(), &needed) {
            Ok(dir) => return Ok(dir.clip().frames.len()),
            Err(error) => first = first.or(Some(error)),
        }
    }
    Err(first.unwrap_or_else(|| FormatError::invalid(&drive.path, "frames", "at least one", "none")))
}

/// The drive that is open.
#[derive(Debug, Default)]
pub struct OpenDrive {
    name: String,
    /// All frames that its snippets need; `None` where some of them cannot be read.
    whole: Option<Arc<ClipDir>>,
}

impl OpenDrive {
    /// A drive with all that a snippet needs. Its snippets share one opening, unless a frame of any of them cannot be read: then each has its own,
    /// so that those without such a frame are none the worse.
    ///
    /// # Errors
    /// Whatever is wrong with the frames of the snippet.
    pub fn get(
        &mut self,
        drive: &Drive,
        all: &[Snippet],
        snippet: &Snippet,
        cameras: Option<&[String]>,
    ) -> Result<Arc<ClipDir>> {
        let open = |frames: Vec<usize>| {
            let needed = Needed { frames: Some(frames), cameras: cameras.map(<[String]>::to_vec) };
            importers::open_scene(&drive.path, drive.scene.as_deref(), &needed).map(Arc::new)
        };
        if self.name != drive.name {
            let mut frames: Vec<usize> = all.iter().flat_map(Snippet::frames).collect();
            frames.sort_unstable();
            frames.dedup();
            *self = Self { name: drive.name.clone(), whole: open(frames).ok() };
        }
        self.whole.as_ref().map_or_else(|| open(snippet.frames()), |dir| Ok(Arc::clone(dir)))
    }
}
