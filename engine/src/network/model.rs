//! The whole model: passes of both branches, query.

use candle_core::{DType, Result};
use candle_nn::VarBuilder;

use super::config::ModelConfig;
use super::guide::refine_inputs;
use super::heads::{HeadSizes, Outputs};
use super::normalise::INITIAL_INPUTS;
use super::pass::Pass;
use super::policy::{EXTRA_INPUTS, Policy};
use super::query::Query;
use super::unet::UNetConfig;
use super::weights::{RandomWeights, Recorder, TensorSpec, WeightFile};
use crate::ops::DEVICE;

/// The model: of one type before and after its normalisation is folded away.
#[derive(Clone, Debug)]
pub struct Model {
    /// The sizes.
    pub config: ModelConfig,
    /// First prediction of the `LiDAR` branch.
    pub initial: Pass,
    /// Refinement of the `LiDAR` branch, shared by its steps.
    pub refine: Pass,
    /// First prediction of the background.
    pub background_initial: Pass,
    /// Refinement of the background.
    pub background_refine: Pass,
    /// Cross-Time Point Query, when the config has one.
    pub query: Option<Query>,
    /// Gaussian Densify Policy, when the config has one.
    pub policy: Option<Policy>,
}

impl Model {
    /// Makes or loads `initial`, `refine`, `background.{initial, refine}`, `query` and `policy`.
    ///
    /// # Errors
    /// When the builder has no such tensor.
    pub fn new(config: &ModelConfig, vb: &VarBuilder<'_>) -> Result<Self> {
        let background = vb.pp("background");
        let pass = |cin: usize, unet: &UNetConfig, outputs, vb: VarBuilder<'_>| {
            let heads = HeadSizes { features: unet.width(), point_inputs: cin, hidden: config.head_width, outputs };
            Pass::new(cin, unet, &heads, &vb)
        };
        let moving = |cin, name: &str| pass(cin, &config.unet, Outputs::Moving, vb.pp(name));
        let still = |cin, name: &str| pass(cin, &config.background_unet, Outputs::Static, background.pp(name));
        let query = config.query.as_ref().map(|_| Query::new(config.unet.width(), &vb.pp("query"))).transpose()?;
        let inputs = config.unet.width() + EXTRA_INPUTS;
        let policy = config.policy.as_ref().map(|policy| Policy::new(inputs, policy, &vb.pp("policy"))).transpose()?;
        Ok(Self {
            config: config.clone(),
            policy,
            initial: moving(INITIAL_INPUTS, "initial")?,
            refine: moving(refine_inputs(config.guidance, true), "refine")?,
            // It has no time of its own, but its input keeps the column.
            background_initial: still(INITIAL_INPUTS, "initial")?,
            background_refine: still(refine_inputs(config.guidance, false), "refine")?,
            query,
        })
    }

    /// The tensors of a model of this size.
    ///
    /// # Errors
    /// Never for a config that was parsed.
    pub fn tensors(config: &ModelConfig) -> Result<Vec<TensorSpec>> {
        Recorder::list(|vb| Self::new(config, vb))
    }

    /// The model as inference runs it, to the bit what it is with running statistics: normalisation folded into weights, these packed once;
    /// constants.
    ///
    /// # Errors
    /// When a tensor cannot be read.
    pub fn fold(&self) -> Result<Self> {
        Ok(Self {
            config: self.config.clone(),
            initial: self.initial.fold()?,
            refine: self.refine.fold()?,
            background_initial: self.background_initial.fold()?,
            background_refine: self.background_refine.fold()?,
            query: self.query.as_ref().map(Query::fold).transpose()?,
            policy: self.policy.as_ref().map(Policy::fold).transpose()?,
        })
    }

    /// The model of a weights file, which is checked as a whole first, folded.
    ///
    /// # Errors
    /// As [`WeightFile::check`].
    pub fn load(config: &ModelConfig, file: &WeightFile) -> crate::error::Result<Self> {
        file.check(&Self::tensors(config)?)?;
        let vb = VarBuilder::from_backend(Box::new(file.clone()), DType::F32, DEVICE);
        Ok(Self::new(config, &vb)?.fold()?)
    }

    /// The model with seeded weights, folded.
    ///
    /// # Errors
    /// Never for a config that was parsed.
    pub fn random(config: &ModelConfig, seed: u64) -> Result<Self> {
        let vb = VarBuilder::from_backend(Box::new(RandomWeights { seed }), DType::F32, DEVICE);
        Self::new(config, &vb)?.fold()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::{Model, ModelConfig, TensorSpec};
    use crate::network::config::QueryConfig;

    fn parameters(config: &ModelConfig) -> usize {
        let tensors = Model::tensors(config).unwrap();
        tensors.iter().filter(|t| t.is_parameter()).map(TensorSpec::len).sum()
    }

    #[test]
    fn parameters_of_the_paper() {
        let path = Path::new("full.json");
        let mut config = ModelConfig::parse(include_str!("../../../models/full.json"), path).unwrap();
        let millions = |config: &ModelConfig| (parameters(config) as f64 / 1e4).round() / 1e2;
        assert_eq!(millions(&config), 95.67);
        config.query = None;
        assert_eq!(millions(&config), 95.65);
        config.policy = None;
        assert_eq!(parameters(&config), 86_959_294);
        config.query = Some(QueryConfig { neighbours: 8 });
        assert_eq!(parameters(&config), 86_959_294 + 18_432);
    }

    #[test]
    fn a_small_size_for_small_machines() {
        let path = Path::new("tiny.json");
        let config = ModelConfig::parse(include_str!("../../../models/tiny.json"), path).unwrap();
        assert!((1_000_000..=3_000_000).contains(&parameters(&config)), "{}", parameters(&config));
    }
}
