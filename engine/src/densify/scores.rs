//! Scores, and the actions that thresholds decide.

use super::Action;
use crate::error::{EngineError, Result};
use crate::gaussians::GaussianSet;
use crate::gaussians::physical::{Splat, to_physical};

/// Scores of the `LiDAR` branch.
///
/// # Shapes
/// Both `[num_lidar]`, in 0..=1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scores {
    /// How much pruning would help.
    pub prune: Vec<f32>,
    /// How much a copy would help.
    pub add: Vec<f32>,
}

/// Scores above these decide.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thresholds {
    /// `theta_p`.
    pub prune: f32,
    /// `theta_a`.
    pub add: f32,
}

impl Default for Thresholds {
    fn default() -> Self {
        Self { prune: 0.7, add: 0.7 }
    }
}

impl Thresholds {
    /// Whether both are those of the paper.
    pub fn are_usual(&self) -> bool {
        *self == Self::default()
    }
}

/// What a policy said of a scene: to look at, not to compute with.
#[derive(Clone, Debug)]
pub struct DensityMap {
    /// The scene that was scored, before the set update.
    pub scored: GaussianSet,
    /// Its scores.
    pub scores: Scores,
    /// Scores of the `LiDAR` branch after the update; a copy has those of its original.
    pub updated: Scores,
}

impl DensityMap {
    /// The scored scene with scores for colours: prune, add, and 1 where there is a score at all; black background.
    pub fn splats(&self) -> Vec<Splat> {
        let mut splats = to_physical(&self.scored);
        let scores = self.scores.prune.iter().zip(&self.scores.add).map(|(&prune, &add)| [prune, add, 1.0]);
        for (splat, colour) in splats.iter_mut().zip(scores.chain(std::iter::repeat([0.0; 3]))) {
            splat.colour = colour;
        }
        splats
    }
}

impl Scores {
    /// The scores at these places.
    pub(crate) fn at(&self, places: &[usize]) -> Self {
        let picked = |scores: &[f32]| places.iter().map(|&i| scores[i]).collect();
        Self { prune: picked(&self.prune), add: picked(&self.add) }
    }

    /// # Errors
    /// When a score is not finite, or the two differ in length.
    fn check(&self) -> Result<()> {
        if self.prune.len() != self.add.len() {
            return Err(EngineError::Setting {
                setting: "densify scores",
                expected: format!("as many prune as add scores ({})", self.prune.len()),
                found: self.add.len().to_string(),
            });
        }
        for (name, scores) in [("prune", &self.prune), ("add", &self.add)] {
            if let Some(i) = scores.iter().position(|s| !s.is_finite()) {
                return Err(EngineError::NonFinite { what: format!("{name} score of Gaussian {i}"), found: scores[i] });
            }
        }
        Ok(())
    }
}

/// The actions that thresholds decide.
///
/// # Errors
/// When a score is not finite.
pub fn by_thresholds(scores: &Scores, thresholds: Thresholds) -> Result<Vec<Action>> {
    scores.check()?;
    let decide = |(&prune, &add): (&f32, &f32)| {
        if prune > thresholds.prune {
            Action::Prune
        } else if add > thresholds.add {
            Action::Copy
        } else {
            Action::Keep
        }
    };
    Ok(scores.prune.iter().zip(&scores.add).map(decide).collect())
}
