//! The scene as Gaussians: raw parameters, their physical values, motion, the background branch.

pub mod background;
mod coarseness;
mod dense;
mod disc;
mod initial;
pub mod motion;
pub mod physical;
pub mod split;

pub use coarseness::Coarseness;
use coarseness::USUAL_PIXELS;
pub(crate) use dense::merge_dense;
pub use initial::initial;

use crate::error::{EngineError, Result};

/// Attributes of one Gaussian: mean 3, quaternion 4, log scale 3, opacity logit 1, colour logit 3.
pub const NUM_ATTRIBUTES: usize = 14;
/// Columns of the mean (metres, clip frame).
pub const MEAN: std::ops::Range<usize> = 0..3;
/// Columns of the quaternion (w, x, y, z; not normalised).
pub const QUAT: std::ops::Range<usize> = 3..7;
/// Columns of the log scale (log metres).
pub const LOG_SCALE: std::ops::Range<usize> = 7..10;
/// Column of the opacity logit.
pub const LOGIT_OPACITY: usize = 10;
/// Columns of the colour logit.
pub const LOGIT_COLOUR: std::ops::Range<usize> = 11..14;

/// What a scene begins with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Start {
    /// Where its background comes from.
    pub background: background::Mode,
    /// How coarse it is.
    pub coarseness: Coarseness,
}

impl From<background::Mode> for Start {
    /// As coarse as usual.
    fn from(background: background::Mode) -> Self {
        Self { background, ..Self::default() }
    }
}

/// A dynamic scene: raw Gaussian parameters with timestamps and velocities.
///
/// # Shapes
/// `attributes` `[N, 14]`, `times` `[N]`, `frames` `[N]`, `velocities` `[N, 3]`. The first `num_lidar` rows are the `LiDAR` branch, the
/// rest is the background: static (velocity zero), but for the own vehicle, which moves with the sensors.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GaussianSet {
    /// `[N, 14]` raw parameters, columns as the constants of this module say; clip frame.
    pub attributes: Vec<[f32; NUM_ATTRIBUTES]>,
    /// `[N]` moment at which a Gaussian stands at its mean, seconds since the clip's time zero.
    pub times: Vec<f32>,
    /// `[N]` index in the clip of the frame that a Gaussian comes from: of its return's sweep, or of the image that asked for it.
    pub frames: Vec<u32>,
    /// `[N, 3]` velocity, metres a second, clip frame.
    pub velocities: Vec<[f32; 3]>,
    /// Number of leading rows that belong to the `LiDAR` branch.
    pub num_lidar: usize,
}

/// Which of its two parts a Gaussian of a scene belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Branch {
    /// Those of the returns.
    Lidar,
    /// What stands behind them, static.
    Background,
}

impl Branch {
    /// Both, in the order of a set.
    pub const ALL: [Self; 2] = [Self::Lidar, Self::Background];

    /// Whether a network gives its Gaussians velocities.
    pub const fn moves(self) -> bool {
        matches!(self, Self::Lidar)
    }
}

/// One Gaussian of a set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaussian {
    /// Raw parameters.
    pub attributes: [f32; NUM_ATTRIBUTES],
    /// Moment at which it stands at its mean, seconds.
    pub time: f32,
    /// Index in the clip of the frame that it comes from.
    pub frame: u32,
    /// Velocity, metres a second.
    pub velocity: [f32; 3],
}

/// The mean of raw parameters, metres.
pub(crate) fn mean_of(attributes: &[f32; NUM_ATTRIBUTES]) -> [f32; 3] {
    std::array::from_fn(|k| attributes[MEAN.start + k])
}

/// Gradients by raw attributes and velocities.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RawGradient {
    /// `[N, 14]`.
    pub attributes: Vec<[f32; NUM_ATTRIBUTES]>,
    /// `[N, 3]`.
    pub velocities: Vec<[f32; 3]>,
}

/// What every Gaussian sees of the errors of rendered views.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeanResiduals {
    /// The error under the Gaussian, taken back to its parameters, over its blending weight.
    pub gradient: RawGradient,
    /// `[N]` its blending weight over all pixels of all views, pixels.
    pub weights: Vec<f32>,
    /// `[N]` the mean absolute error of the colours under it.
    pub errors: Vec<f32>,
}

impl GaussianSet {
    /// Number of Gaussians of both branches.
    pub fn len(&self) -> usize {
        self.attributes.len()
    }

    /// Whether there is no Gaussian at all.
    pub fn is_empty(&self) -> bool {
        self.attributes.is_empty()
    }

    /// The rows of a branch.
    pub fn rows(&self, branch: Branch) -> std::ops::Range<usize> {
        match branch {
            Branch::Lidar => 0..self.num_lidar,
            Branch::Background => self.num_lidar..self.len(),
        }
    }

    /// The branch that Gaussian `i` belongs to.
    pub(crate) fn branch_of(&self, i: usize) -> Branch {
        if i < self.num_lidar { Branch::Lidar } else { Branch::Background }
    }

    /// Number of Gaussians of the background.
    pub fn num_background(&self) -> usize {
        self.len() - self.num_lidar
    }

    /// The mean of Gaussian `i`, metres, at its own moment.
    ///
    /// # Panics
    /// When there is no such Gaussian.
    pub fn mean(&self, i: usize) -> [f32; 3] {
        mean_of(&self.attributes[i])
    }

    /// Adds a Gaussian at the end; which branch it belongs to is the caller's to say.
    pub fn push(&mut self, gaussian: Gaussian) {
        self.attributes.push(gaussian.attributes);
        self.times.push(gaussian.time);
        self.frames.push(gaussian.frame);
        self.velocities.push(gaussian.velocity);
    }

    /// The Gaussians at `rows`, in their order; the first `num_lidar` of them are the `LiDAR` branch.
    ///
    /// # Panics
    /// When there is no Gaussian at one of `rows`.
    #[must_use]
    pub fn select(&self, rows: &[usize], num_lidar: usize) -> Self {
        Self {
            attributes: rows.iter().map(|&i| self.attributes[i]).collect(),
            times: rows.iter().map(|&i| self.times[i]).collect(),
            frames: rows.iter().map(|&i| self.frames[i]).collect(),
            velocities: rows.iter().map(|&i| self.velocities[i]).collect(),
            num_lidar,
        }
    }

    /// Adds all Gaussians of another set at the end; which branch they belong to is the caller's to say.
    pub fn append(&mut self, other: &Self) {
        self.attributes.extend(&other.attributes);
        self.times.extend(&other.times);
        self.frames.extend(&other.frames);
        self.velocities.extend(&other.velocities);
    }

    /// Removes the background.
    pub fn drop_background(&mut self) {
        self.attributes.truncate(self.num_lidar);
        self.times.truncate(self.num_lidar);
        self.frames.truncate(self.num_lidar);
        self.velocities.truncate(self.num_lidar);
    }

    /// Fails where a value is not finite.
    ///
    /// # Errors
    /// [`EngineError::NonFinite`] for the first Gaussian with a value that is not, by its attribute.
    pub fn check_finite(&self) -> Result<()> {
        let rows = self.attributes.iter().zip(&self.velocities).zip(&self.times);
        for (i, ((attributes, velocity), time)) in rows.enumerate() {
            let values = attributes.iter().chain(velocity).chain([time]);
            let mut values = values.enumerate();
            if let Some((column, &found)) = values.find(|(_, value)| !value.is_finite()) {
                return Err(EngineError::NonFinite { what: format!("Gaussian {i}, {}", column_name(column)), found });
            }
        }
        Ok(())
    }
}

const fn column_name(column: usize) -> &'static str {
    match column {
        0..3 => "mean",
        3..7 => "quaternion",
        7..10 => "log scale",
        10 => "opacity logit",
        11..14 => "colour logit",
        14..17 => "velocity",
        _ => "time",
    }
}
