//! Points: sweeps in the clip frame, their colours and their spacing.

mod aggregate;
mod occlusion;
mod paint;
mod spacing;
mod stamp;
mod stray;
mod turn;

pub use aggregate::aggregate;
pub(crate) use occlusion::DepthGrid;
pub use paint::paint;
pub(crate) use paint::{moved, sample, samples_at, samples_of};
pub use spacing::{bounded, spacing};
pub(crate) use stamp::sweep_seconds;
pub use stamp::{Stamp, Timing};
pub use stray::Dropped;
pub(crate) use stray::drop_strays;
pub use turn::Turn;
pub(crate) use turn::{standing, tell_apart};

/// `LiDAR` returns of several sweeps in the clip frame.
///
/// # Shapes
/// Every vector is `[N]`, sweep by sweep, in the order of the files.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Where the returns are, metres, clip frame.
    pub positions: Vec<[f32; 3]>,
    /// When each was measured, or the timestamp of its sweep where nothing is known of single returns; seconds since the clip's time zero.
    pub times: Vec<f32>,
    /// Index in the clip of the frame that they come from.
    pub frames: Vec<u32>,
    /// Where the sensor was when it measured each, metres, clip frame: where its ray starts.
    pub origins: Vec<[f32; 3]>,
    /// Rows of the sweeps' files that are no return.
    pub num_missing: usize,
}

impl PointCloud {
    /// Number of returns.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// How far returns are from where their sensor was, metres.
    ///
    /// # Shapes
    /// `chosen` `[M]` indices of returns; result `[M]`.
    pub(crate) fn ranges(&self, chosen: &[u32]) -> Vec<f32> {
        let range = |&i: &u32| {
            let (position, origin) = (self.positions[i as usize], self.origins[i as usize]);
            (0..3).map(|k| (position[k] - origin[k]).powi(2)).sum::<f32>().sqrt()
        };
        chosen.iter().map(range).collect()
    }

    /// Whether there is no return at all.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }
}
