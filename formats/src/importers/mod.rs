//! Foreign layouts: folders and files as the owners of public data sets write them, read as clips.
//!
//! Each importer turns a layout into a [`Clip`] whose files lie where they are, with a decoder for its sweeps; [`open`]
//! makes a [`ClipDir`] of it, and [`write()`] a clip directory. Intrinsics come out with pixel centres at +0.5, poses in
//! the data set's own world, timestamps in its own clock, seconds.

mod additions;
mod argoverse2;
mod dgp;
mod feather;
mod kitti;
mod moment;
mod nearest;
mod npz;
mod nuscenes;
mod open;
mod pandaset;
mod parquet;
mod pickle;
mod table;
mod trajectory;
mod values;
mod waymo;
mod write;

use std::{
    fmt,
    path::{Path, PathBuf},
    sync::Arc,
};

use crate::{clip::Frame, clip_dir::Decode, error::Result};

pub use additions::{Additions, DepthFolder};
pub use open::{open, open_as, open_part, open_scene, scenes};
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
    /// A drive of the Waymo Open Dataset, of either form.
    Waymo,
}

impl Layout {
    /// Every layout.
    pub const ALL: [Self; 6] =
        [Self::Dgp, Self::KittiRaw, Self::Argoverse2, Self::PandaSet, Self::NuScenes, Self::Waymo];

    /// Whether a folder, or a file, looks like this layout.
    pub fn is_of(self, folder: &Path) -> bool {
        match self {
            Self::Dgp => dgp::is_of(folder),
            Self::KittiRaw => kitti::is_of(folder),
            Self::Argoverse2 => argoverse2::is_of(folder),
            Self::PandaSet => pandaset::is_of(folder),
            Self::NuScenes => nuscenes::is_of(folder),
            Self::Waymo => waymo::is_of(folder),
        }
    }

    /// Whether a folder holds some of what this layout asks for: it is of no other, so that reading it says what is missing.
    fn resembles(self, folder: &Path) -> bool {
        match self {
            Self::Dgp => dgp::resembles(folder),
            Self::KittiRaw => kitti::resembles(folder),
            Self::Argoverse2 => argoverse2::resembles(folder),
            Self::PandaSet => pandaset::resembles(folder),
            Self::NuScenes => nuscenes::resembles(folder),
            Self::Waymo => waymo::resembles(folder),
        }
    }

    fn read(self, folder: &Path, selection: &Selection) -> Result<Source> {
        match self {
            Self::Dgp => dgp::read(folder, selection),
            Self::KittiRaw => kitti::read(folder, selection),
            Self::Argoverse2 => argoverse2::read(folder, selection),
            Self::PandaSet => pandaset::read(folder, selection),
            Self::NuScenes => nuscenes::read(folder, selection),
            Self::Waymo => waymo::read(folder, selection),
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
            Self::Waymo => "waymo",
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
    /// Names of `LiDARs`, where a folder has several.
    pub lidars: Option<Vec<String>>,
}

impl Selection {
    /// Whether a camera is wanted: of others an importer looks at nothing but their names.
    fn camera(&self, name: &str) -> bool {
        self.cameras.as_ref().is_none_or(|cameras| cameras.iter().any(|camera| camera == name))
    }

    /// Whether a `LiDAR` is wanted.
    fn lidar(&self, name: &str) -> bool {
        self.lidars.as_ref().is_none_or(|lidars| lidars.iter().any(|lidar| lidar == name))
    }

    /// Whether a frame is wanted. An importer may take another one for an error without reading it.
    fn frame(&self, index: usize) -> bool {
        self.frames.as_ref().is_none_or(|frames| frames.contains(&index))
    }
}

/// A foreign folder, read but for its sweeps and images.
#[derive(Debug)]
struct Source {
    /// What the clip's files are relative to.
    root: PathBuf,
    name: String,
    source: String,
    licence: String,
    /// Frames with the wanted cameras. One that cannot be read is an error to who wants it.
    frames: Vec<Result<Frame>>,
    /// Every camera that has images, wanted or not.
    cameras: Vec<String>,
    /// Every `LiDAR` that can be wanted by its name; none where there is one.
    lidars: Vec<String>,
    decoder: Arc<dyn Decode>,
}

/// The name of the clip of a folder: that of the folder itself.
fn folder_name(folder: &Path) -> String {
    let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    absolute.file_name().map_or_else(|| "clip".to_owned(), |name| name.to_string_lossy().into_owned())
}
