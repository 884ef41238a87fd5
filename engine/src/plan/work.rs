//! How much there is to do on a clip.

use serde::{Deserialize, Serialize};

/// How much there is to do on a clip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipWork {
    /// `LiDAR` Gaussians at the beginning.
    pub points: usize,
    /// Pixels of all input views.
    pub pixels: usize,
    /// Input views.
    pub views: usize,
}
