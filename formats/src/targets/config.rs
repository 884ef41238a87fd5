//! What decided the values of the targets.

use serde::{Deserialize, Serialize};

/// What the effect of an action is measured by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Signal {
    /// Change of the neighbours' gradient responses (the paper).
    Response,
    /// Change of the loss under the primitive's own blending weights.
    Footprint,
    /// No intervention: the primitive's own response.
    Magnitude,
    /// Exact change of the loss without the primitive, and what its halves could gain.
    Exact,
}

/// Whose largest gradients the responses are divided by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Normalise {
    /// Each branch by its own (the paper's formula).
    Branch,
    /// All branches by those of the original one.
    Original,
}

/// The population of the z-score.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ZScore {
    /// Both actions together.
    Joint,
    /// Each action by itself.
    PerAction,
}

/// Every setting that changes a value of a shard.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetsConfig {
    /// What effects are measured by.
    pub signal: Signal,
    /// Whose largest gradients divide.
    pub normalise: Normalise,
    /// Rounds of sampling.
    pub rounds: u8,
    /// Probability with which a round samples a primitive.
    pub rho: f64,
    /// Neighbours whose responses are summed.
    pub neighbours: usize,
    /// Standard deviation of a copy's displacement per axis, metres.
    pub noise_m: f64,
    /// Delta at which the logarithm begins to bend.
    pub log_scale: f64,
    /// Population of the z-score.
    pub zscore: ZScore,
    /// Whether decoder features are stored.
    pub with_features: bool,
    /// Names of the cameras; `None` for all.
    pub cameras: Option<Vec<String>>,
    /// Height and width of the images, pixels; `None` for their own.
    pub image_size: Option<[usize; 2]>,
    /// Seed of everything that is drawn at random.
    pub seed: u64,
    /// SHA-256 of the weights file, `random:` and that of the config file, or `None` for the initial set.
    pub weights: Option<String>,
}

impl Default for TargetsConfig {
    /// What `lgs-targetgen` takes where nobody says otherwise: the paper's signal, of the initial set.
    fn default() -> Self {
        Self {
            signal: Signal::Response,
            normalise: Normalise::Branch,
            rounds: 3,
            rho: 0.2,
            neighbours: 8,
            noise_m: 0.01,
            log_scale: 1.0,
            zscore: ZScore::Joint,
            with_features: false,
            cameras: None,
            image_size: None,
            seed: 0,
            weights: None,
        }
    }
}
