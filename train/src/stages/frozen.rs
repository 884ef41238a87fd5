//! The policy while the rest is trained: its decisions are applied, its weights stay.

use lgs_engine::{
    densify::{Action, Scores, decide},
    gaussians::GaussianSet,
    network::{config::ModelConfig, policy::Policy},
    predict::scores_of,
};

use super::{passes::Outcome, settings::Settings, variables::Variables};
use crate::error::{Result, TrainError};

/// A policy that is not trained.
#[derive(Debug)]
pub struct FrozenPolicy {
    policy: Policy,
    config: ModelConfig,
}

impl FrozenPolicy {
    /// The policy of a model.
    ///
    /// # Errors
    /// When the model has none.
    pub fn of(variables: &Variables) -> Result<Self> {
        let config = variables.config().clone();
        match variables.model()?.policy {
            Some(policy) => Ok(Self { policy: policy.fold()?, config }),
            None => Err(TrainError::config("policy", "a model with a policy", "one without")),
        }
    }

    /// What it decides on a scene as predicted; `None` where there is nothing to decide on.
    ///
    /// # Errors
    /// When a score is not finite, or a position leaves the voxel grid.
    pub(crate) fn actions(
        &self,
        outcomes: &[Outcome],
        predicted: &GaussianSet,
        settings: &Settings,
    ) -> Result<Option<Vec<Action>>> {
        let (Some(outcome), Some((thresholds, limit))) = (outcomes.first(), settings.update()) else { return Ok(None) };
        if predicted.num_lidar == 0 {
            return Ok(None);
        }
        let [prune, add] = scores_of(&outcome.features, predicted, &self.policy, &self.config)?;
        let scores = Scores { prune, add };
        Ok(Some(decide(&scores, thresholds, limit)?))
    }
}
