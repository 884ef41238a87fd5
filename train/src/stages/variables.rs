//! The values of a model while they are trained.

use std::collections::HashMap;

use candle_core::{DType, Tensor, Var, backprop::GradStore};
use candle_nn::{VarBuilder, var_builder::SimpleBackend};
use lgs_engine::{
    network::{
        config::ModelConfig,
        model::Model,
        weights::{RandomWeights, TensorSpec},
    },
    ops::DEVICE,
};

use crate::error::Result;

/// Values of every tensor, `[tensors][values]`, in the order of [`Variables::specs`].
pub type Values = Vec<Vec<f32>>;

/// The tensors of a model as variables.
#[derive(Debug)]
pub struct Variables {
    config: ModelConfig,
    specs: Vec<TensorSpec>,
    vars: Vec<Var>,
}

impl Variables {
    /// Seeded values.
    ///
    /// # Errors
    /// Never for a config that was parsed.
    pub fn seeded(config: &ModelConfig, seed: u64) -> Result<Self> {
        let specs = Model::tensors(config)?;
        let draw = |spec: &TensorSpec| {
            let shape = spec.shape.clone().into();
            let drawn = RandomWeights { seed }.get(shape, &spec.name, spec.init, DType::F32, &DEVICE)?;
            Var::from_tensor(&drawn)
        };
        let vars = specs.iter().map(draw).collect::<candle_core::Result<_>>()?;
        Ok(Self { config: config.clone(), specs, vars })
    }

    /// Given values.
    ///
    /// # Errors
    /// When their number does not fit the model.
    pub fn with_values(config: &ModelConfig, values: &Values) -> Result<Self> {
        let variables = Self::seeded(config, 0)?;
        for (k, values) in values.iter().enumerate() {
            variables.set(k, values.clone())?;
        }
        Ok(variables)
    }

    /// What the tensors are called and how large they are.
    pub fn specs(&self) -> &[TensorSpec] {
        &self.specs
    }

    /// The sizes of the model.
    pub fn config(&self) -> &ModelConfig {
        &self.config
    }

    /// The trainable model on these variables.
    ///
    /// # Errors
    /// Never for variables of this type.
    pub fn model(&self) -> Result<Model> {
        let named = self.specs.iter().zip(&self.vars).map(|(spec, var)| (spec.name.clone(), var.as_tensor().clone()));
        let tensors: HashMap<String, Tensor> = named.collect();
        Ok(Model::new(&self.config, &VarBuilder::from_tensors(tensors, DType::F32, &DEVICE))?)
    }

    /// The values of all tensors.
    ///
    /// # Errors
    /// When a tensor cannot be read.
    pub fn values(&self) -> Result<Values> {
        Ok(self.vars.iter().map(|var| var.flatten_all()?.to_vec1()).collect::<candle_core::Result<_>>()?)
    }

    /// Sets the values of tensor `k`.
    ///
    /// # Errors
    /// When their number is another.
    pub fn set(&self, k: usize, values: Vec<f32>) -> Result<()> {
        Ok(self.vars[k].set(&Tensor::from_vec(values, self.specs[k].shape.clone(), &DEVICE)?)?)
    }

    /// Adds gradients to `sums`; a tensor without one adds nothing.
    ///
    /// # Errors
    /// When a tensor cannot be read.
    pub fn add_gradients(&self, store: &GradStore, sums: &mut Values) -> Result<()> {
        for (var, sums) in self.vars.iter().zip(sums) {
            if let Some(gradient) = store.get(var) {
                let values = gradient.flatten_all()?.to_vec1::<f32>()?;
                sums.iter_mut().zip(values).for_each(|(sum, v)| *sum += v);
            }
        }
        Ok(())
    }

    /// Zeros in the shape of the tensors.
    pub fn zeros(&self) -> Values {
        self.specs.iter().map(|spec| vec![0.0; spec.len()]).collect()
    }
}
