//! Foreign layouts: folders as the owners of public data sets write them, read as clips.
//!
//! Each importer turns a layout into a [`Clip`] whose files lie where they are, with a decoder for its sweeps; [`open`]
//! makes a [`ClipDir`] of it, and [`write()`] a clip directory. Intrinsics come out with pixel centres at +0.5, poses in
//! the data set's own world, timestamps in its own clock, seconds.

mod additions;
mod argoverse2;
mod dgp;
mod feather;
mod kitti;
mod nearest;
mod npz;
mod nuscenes;
mod pandaset;
mod pickle;
mod table;
mod trajectory;
mod values;
mod write;

use std::{
    fmt,
    path::{Path, PathBuf},
    sync::Arc,
};

use crate::{
    clip::Clip,
    clip_dir::{CLIP_FILE, ClipDir, SweepDecoder},
    error::{FormatError, Result},
};

pub use additions::{Additions, DepthFolder};
pub use write::{write, write_with};

/// A foreign layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// A scene of TRI's dataset governance policy, such as DDAD.
    Dgp,
    /// A drive of KITTI raw.
    KittiRaw,
    /// A log of the Argoverse 2 sensor data set.
    Argoverse2,
    /// A sequence of `PandaSet`.
    PandaSet,
    /// A `nuScenes` release.
    NuScenes,
}

impl Layout {
    /// Every layout.
    pub const ALL: [Self; 5] = [Self::Dgp, Self::KittiRaw, Self::Argoverse2, Self::PandaSet, Self::NuScenes];

    /// Whether a folder looks like this layout.
    pub fn is_of(self, folder: &Path) -> bool {
        match self {
            Self::Dgp => dgp::is_of(folder),
            Self::KittiRaw => kitti::is_of(folder),
            Self::Argoverse2 => argoverse2::is_of(folder),
            Self::PandaSet => pandaset::is_of(folder),
            Self::NuScenes => nuscenes::is_of(folder),
        }
    }

    fn read(self, folder: &Path, scene: Option<&str>) -> Result<Source> {
        match self {
            Self::Dgp => dgp::read(folder),
            Self::KittiRaw => kitti::read(folder),
            Self::Argoverse2 => argoverse2::read(folder),
            Self::PandaSet => pandaset::read(folder),
            Self::NuScenes => nuscenes::read(folder, scene),
        }
    }
}

impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Dgp => "dgp",
            Self::KittiRaw => "kitti-raw",
            Self::Argoverse2 => "av2",
            Self::PandaSet => "pandaset",
            Self::NuScenes => "nuscenes",
        })
    }
}

/// What to take of a folder; the default takes all.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// Name of the scene, where a folder holds several.
    pub scene: Option<String>,
    /// Indices of frames.
    pub frames: Option<Vec<usize>>,
    /// Names of cameras.
    pub cameras: Option<Vec<String>>,
}

/// A foreign folder, read but for its sweeps and images.
#[derive(Debug)]
struct Source {
    /// What the clip's files are relative to.
    root: PathBuf,
    clip: Clip,
    decoder: Arc<dyn SweepDecoder>,
}

/// The clip of a directory with a `clip.json`, or of a folder of a foreign layout, whichever `path` is.
///
/// # Errors
/// Those of [`ClipDir::open`] and [`open_as`]; a folder of neither kind.
pub fn open(path: &Path) -> Result<ClipDir> {
    if path.is_file() {
        return Err(FormatError::invalid(path, "layout", "a folder", "a file"));
    }
    if !path.is_dir() || path.join(CLIP_FILE).exists() {
        return ClipDir::open(path);
    }
    match Layout::ALL.into_iter().find(|layout| layout.is_of(path)) {
        Some(layout) => open_as(layout, path, &Selection::default()),
        None => {
            let names = Layout::ALL.map(|layout| layout.to_string()).join(", ");
            let expected = format!("`{CLIP_FILE}` or the files of one of {names}");
            let found = values::entries(path, &[""])?.into_iter().take(5).collect::<Vec<_>>().join(", ");
            let found = if found.is_empty() { "nothing".to_owned() } else { format!("`{found}`") };
            Err(FormatError::invalid(path, "layout", expected, found))
        }
    }
}

/// The clip of a folder of a foreign layout.
///
/// # Errors
/// A file that is missing, damaged or of another form than the layout's; frames, cameras or a scene that it does not have.
pub fn open_as(layout: Layout, path: &Path, selection: &Selection) -> Result<ClipDir> {
    if let Some(scene) = selection.scene.as_ref().filter(|_| layout != Layout::NuScenes) {
        let expected = format!("none: a folder of {layout} holds one scene");
        return Err(FormatError::invalid(path, "--scene", expected, format!("`{scene}`")));
    }
    if let Some(other) = Layout::ALL.into_iter().find(|other| !layout.is_of(path) && other.is_of(path)) {
        return Err(FormatError::invalid(
            path,
            "layout",
            format!("the files of {layout}"),
            format!("those of {other}"),
        ));
    }
    let Source { root, mut clip, decoder } = layout.read(path, selection.scene.as_deref())?;
    if let Some(frames) = &selection.frames {
        clip.frames = take_frames(path, &clip, frames)?;
    }
    if let Some(cameras) = &selection.cameras {
        keep_cameras(path, &mut clip, cameras)?;
    }
    if clip.frames.is_empty() {
        return Err(FormatError::invalid(path, "frames", "at least one frame", "none"));
    }
    ClipDir::foreign(&root, &clip, decoder)
}

fn take_frames(path: &Path, clip: &Clip, frames: &[usize]) -> Result<Vec<crate::clip::Frame>> {
    let of_index = |&index: &usize| {
        clip.frames.get(index).cloned().ok_or_else(|| {
            let expected = format!("indices below {}, the number of frames", clip.frames.len());
            FormatError::invalid(path, "--frames", expected, index.to_string())
        })
    };
    frames.iter().map(of_index).collect()
}

fn keep_cameras(path: &Path, clip: &mut Clip, cameras: &[String]) -> Result<()> {
    let mut known: Vec<String> =
        clip.frames.iter().flat_map(|f| &f.cameras).map(|record| record.camera.name.clone()).collect();
    known.sort_unstable();
    known.dedup();
    if let Some(unknown) = cameras.iter().find(|name| !known.contains(name)) {
        let expected = format!("one of {}", known.join(", "));
        return Err(FormatError::invalid(path, "--cameras", expected, format!("`{unknown}`")));
    }
    for frame in &mut clip.frames {
        frame.cameras.retain(|record| cameras.contains(&record.camera.name));
    }
    Ok(())
}

/// The name of the clip of a folder: that of the folder itself.
fn folder_name(folder: &Path) -> String {
    let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    absolute.file_name().map_or_else(|| "clip".to_owned(), |name| name.to_string_lossy().into_owned())
}
