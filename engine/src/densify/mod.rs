//! The set update: which primitives go, which get a copy beside them.
//!
//! # Formula
//! Keep i iff `p_prune_i <= theta_p`; add a copy of i iff `p_add_i > theta_a` and `p_prune_i <= theta_p`. The copy has every attribute of i and
//! stands at `x + N(0, 0.01 m)` per axis.
//!
//! # Source
//! The paper, section 3.2, feed-forward density adjustment.

mod apply;
mod budget;
mod halve;
mod limit;
mod random;
mod scores;
#[cfg(test)]
mod tests;

pub use apply::{COPY_NOISE, apply, origins};
pub use budget::{by_budget, decide};
pub use halve::{Change, change};
pub use limit::Limit;
pub use random::at_random;
pub use scores::{DensityMap, Scores, Thresholds, by_thresholds};

/// Who decides what is pruned and added.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Density {
    /// The learned policy.
    Policy,
    /// What taking each out costs in the input views, measured in rounds.
    Exact,
    /// Chance, as often as the policy would: the ablation.
    Random,
    /// Nobody: the set stays as it is.
    Off,
}

/// Which Gaussians exact pruning may take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scope {
    /// Those of both branches.
    #[default]
    All,
    /// Those of the `LiDAR` branch.
    Lidar,
}

impl Scope {
    /// Whether it is the usual one.
    pub fn is_usual(&self) -> bool {
        *self == Self::default()
    }
}

/// What happens to one primitive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// It stays as it is.
    Keep,
    /// It is taken out.
    Prune,
    /// It stays and a copy comes beside it.
    Copy,
}

/// How many primitives an update took out and added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UpdateCounts {
    /// Taken out.
    pub pruned: usize,
    /// Copies added.
    pub added: usize,
    /// Taken out of the background.
    pub background_pruned: usize,
}

/// How many prunes and copies there are.
pub fn count(actions: &[Action]) -> UpdateCounts {
    let number = |action| actions.iter().filter(|&&a| a == action).count();
    UpdateCounts { pruned: number(Action::Prune), added: number(Action::Copy), background_pruned: 0 }
}
