//! Models whose heads are not zero, in memory and as weights files.

use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::path::Path;

use candle_core::{DType, Device, Tensor};
use candle_nn::var_builder::SimpleBackend;
use candle_nn::{Init, VarBuilder};
use lgs_engine::network::config::ModelConfig;
use lgs_engine::network::model::Model;
use lgs_engine::network::source::CONFIG_KEY;
use lgs_engine::network::weights::RandomWeights;

use crate::random::Random;

/// A small model with all parts.
pub const SMALL: &str = r#"{
  "format": "lgs-model/1", "name": "small", "voxel_size": 0.2, "background_voxel_size": 1.0,
  "unet": { "stem": 8, "encoder": [8, 16], "decoder": [16, 8] },
  "background_unet": { "stem": 8, "encoder": [8], "decoder": [8] },
  "query": { "neighbours": 4 },
  "policy": {
    "encoder": [{ "channels": 8, "heads": 1, "blocks": 2 }, { "channels": 16, "heads": 2, "blocks": 1 }],
    "decoder": [{ "channels": 8, "heads": 1, "blocks": 1 }], "patch": 32, "mlp_ratio": 2,
    "curves": ["z", "z-trans", "hilbert", "hilbert-trans"], "cycle": "continue", "head_blocks": 1, "head_width": 8
  }
}"#;

/// How large the weights are that start at zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heads {
    /// Of the heads for residuals and velocities, and of the query.
    pub residuals: f32,
    /// Of the policy's heads.
    pub scores: f32,
}

impl Heads {
    /// All zero, as before training.
    pub const ZERO: Self = Self { residuals: 0.0, scores: 0.0 };
}

/// A config and its tensors.
#[derive(Clone, Debug)]
pub struct Weights {
    /// The config as JSON.
    pub config: String,
    /// By name.
    pub tensors: BTreeMap<String, Tensor>,
}

impl Weights {
    /// Seeded weights of a config; those that start at zero are normal with the spread of `heads`.
    ///
    /// # Errors
    /// The config is invalid.
    pub fn seeded(config: &str, seed: u64, heads: Heads) -> Result<Self, String> {
        let parsed = ModelConfig::parse(config, Path::new("config.json")).map_err(|e| e.to_string())?;
        let (drawn, mut random) = (RandomWeights { seed }, Random::new(seed));
        let mut tensors = BTreeMap::new();
        for spec in Model::tensors(&parsed).map_err(|e| e.to_string())? {
            let shape = candle_core::Shape::from(spec.shape.clone());
            let starts_at_zero = matches!(spec.init, Init::Const(0.0));
            let tensor = if starts_at_zero && spec.name.ends_with(".weight") {
                let spread = if spec.name.starts_with("policy.") { heads.scores } else { heads.residuals };
                let values: Vec<f32> = (0..spec.len()).map(|_| spread * random.normal_single()).collect();
                Tensor::from_vec(values, shape, &Device::Cpu)
            } else {
                drawn.get(shape, &spec.name, spec.init, DType::F32, &Device::Cpu)
            };
            tensors.insert(spec.name, tensor.map_err(|e| e.to_string())?);
        }
        Ok(Self { config: config.to_owned(), tensors })
    }

    /// The weights with the heads of the refinement negated: its steps go in the other direction from the same start.
    ///
    /// # Errors
    /// Never.
    pub fn backwards(&self) -> Result<Self, String> {
        self.with(|name, tensor| if name.contains("refine.heads.") { tensor.neg() } else { Ok(tensor.clone()) })
    }

    /// The weights with velocity heads of zero: nothing starts to move, which the loss would charge for in either direction.
    ///
    /// # Errors
    /// Never.
    pub fn at_rest(&self) -> Result<Self, String> {
        self.with(|name, tensor| if name.contains("heads.velocity") { tensor.zeros_like() } else { Ok(tensor.clone()) })
    }

    fn with(&self, change: impl Fn(&str, &Tensor) -> candle_core::Result<Tensor>) -> Result<Self, String> {
        let mut other = self.clone();
        for (name, tensor) in &mut other.tensors {
            *tensor = change(name, tensor).map_err(|e| e.to_string())?;
        }
        Ok(other)
    }

    /// The model as inference runs it.
    ///
    /// # Errors
    /// The tensors are not the config's.
    pub fn model(&self) -> Result<Model, String> {
        let config = ModelConfig::parse(&self.config, Path::new("config.json")).map_err(|e| e.to_string())?;
        let tensors: HashMap<String, Tensor> = self.tensors.clone().into_iter().collect();
        let vb = VarBuilder::from_tensors(tensors, DType::F32, &Device::Cpu);
        Model::new(&config, &vb).and_then(|model| model.fold()).map_err(|e| e.to_string())
    }

    /// The bytes of a weights file.
    ///
    /// # Errors
    /// Never for a type that files may have.
    pub fn bytes(&self, dtype: DType) -> Result<Vec<u8>, String> {
        let cast: Result<Vec<(&String, Tensor)>, _> =
            self.tensors.iter().map(|(name, t)| Ok((name, t.to_dtype(dtype)?))).collect();
        let cast = cast.map_err(|e: candle_core::Error| e.to_string())?;
        let metadata = HashMap::from([(CONFIG_KEY.to_owned(), self.config.clone())]);
        safetensors::serialize(cast, Some(metadata)).map_err(|e| e.to_string())
    }

    /// Writes a weights file of f32.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), String> {
        fs::write(path, self.bytes(DType::F32)?).map_err(|e| format!("{}: {e}", path.display()))
    }
}
