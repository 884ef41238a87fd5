//! Points: sweeps in the clip frame, their colours and their spacing.

mod aggregate;
mod occlusion;
mod paint;
mod spacing;

pub use aggregate::aggregate;
pub(crate) use occlusion::DepthGrid;
pub use paint::paint;
pub(crate) use paint::sample;
pub use spacing::{bounded, spacing};

/// `LiDAR` returns of several sweeps in the clip frame.
///
/// # Shapes
/// Every vector is `[N]`, sweep by sweep, in the order of the files.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Where the returns are, metres, clip frame.
    pub positions: Vec<[f32; 3]>,
    /// Timestamp of their sweep, seconds since the clip's time zero.
    pub times: Vec<f32>,
    /// Index in the clip of the frame that they come from.
    pub frames: Vec<u32>,
}

impl PointCloud {
    /// Number of returns.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there is no return at all.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }
}
