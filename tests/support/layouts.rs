//! The foreign folders of `tests/fixtures`: one drive as six data sets store it, one of them in two forms. What is in them: see
//! their `make.py` and `waymo.py`.

use std::path::PathBuf;

use crate::places;

/// A folder of a foreign layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Foreign {
    /// What `lgs-clip import` calls the layout.
    pub layout: &'static str,
    /// Where the drive is in `tests/fixtures`.
    pub folder: &'static str,
    /// Name of its camera.
    pub camera: &'static str,
}

/// Every foreign folder.
pub const FOREIGN: [Foreign; 7] = [
    Foreign { layout: "dgp", folder: "dgp", camera: "CAMERA_01" },
    Foreign { layout: "kitti-raw", folder: "kitti", camera: "image_02" },
    Foreign { layout: "av2", folder: "av2", camera: "ring_front_center" },
    Foreign { layout: "pandaset", folder: "pandaset", camera: "front_camera" },
    Foreign { layout: "nuscenes", folder: "nuscenes", camera: "CAM_FRONT" },
    Foreign { layout: "waymo", folder: "waymo", camera: "FRONT" },
    Foreign { layout: "waymo", folder: "waymo_v2", camera: "FRONT" },
];

impl Foreign {
    /// The folder.
    pub fn path(&self) -> PathBuf {
        places::repository().join("tests/fixtures").join(self.folder)
    }
}

/// The folder of a layout.
///
/// # Errors
/// No such layout.
pub fn foreign(layout: &str) -> Result<Foreign, String> {
    FOREIGN.into_iter().find(|found| found.layout == layout).ok_or_else(|| format!("no layout {layout}"))
}
