//! Checkpoints: everything that a run needs to go on as if it had never stopped, and the weights for inference.

use std::path::Path;

use lgs_engine::network::{config::ModelConfig, model::Model, weights::TensorSpec};
use lgs_formats::error::FormatError;
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};

use super::{
    adamw::AdamW,
    settings::{RunSettings, StageName},
    variables::{Values, Variables},
    weights::{Precision, Stored, json, write_file, write_weights},
};
use crate::error::{Result, TrainError};

/// Name of the file that a run goes on from.
pub const CHECKPOINT_FILE: &str = "checkpoint.safetensors";
/// Name of the file that inference loads: the average of the weights.
pub const WEIGHTS_FILE: &str = "weights.safetensors";

const FORMAT: &str = "lgs-checkpoint/1";
/// The one key of the metadata: one key has one order.
const METADATA_KEY: &str = "checkpoint";

/// The state of a run between two steps. The draws of a step depend on the seed and the step alone, so the step is their state.
#[derive(Debug)]
pub struct State<S> {
    /// Settings of the run.
    pub settings: S,
    /// Steps done.
    pub step: u64,
    /// Of these, steps that were skipped because something was not finite.
    pub skipped: u64,
    /// The weights.
    pub variables: Variables,
    /// The average of the weights.
    pub average: Values,
    /// The optimiser.
    pub adam: AdamW,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Metadata<S> {
    format: String,
    #[serde(default)]
    stage: StageName,
    config: ModelConfig,
    settings: S,
    step: u64,
    updates: u64,
    skipped: u64,
}

/// The stage of a checkpoint, before anything else of it is understood.
#[derive(Deserialize)]
struct Stage {
    #[serde(default)]
    stage: StageName,
}

impl<S: RunSettings> State<S> {
    /// The start of a run with seeded weights.
    ///
    /// # Errors
    /// When a setting is out of its range.
    pub fn new(config: &ModelConfig, settings: S) -> Result<Self> {
        let variables = Variables::seeded(config, settings.optimisation().seed)?;
        Self::of(variables, settings)
    }

    /// The start of a run with given weights.
    ///
    /// # Errors
    /// When a setting is out of its range.
    pub fn of(variables: Variables, settings: S) -> Result<Self> {
        settings.validate()?;
        let (adam, average) = (AdamW::new(&variables), variables.values()?);
        Ok(Self { settings, step: 0, skipped: 0, variables, average, adam })
    }

    /// Writes the checkpoint and the weights of this state into `dir`, each as a whole.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, dir: &Path) -> Result<()> {
        let metadata = Metadata {
            format: FORMAT.to_owned(),
            stage: self.settings.stage(),
            config: self.variables.config().clone(),
            settings: self.settings.clone(),
            step: self.step,
            updates: self.adam.updates,
            skipped: self.skipped,
        };
        let values = self.variables.values()?;
        let parts = [
            ("weights", &values),
            ("average", &self.average),
            ("first", &self.adam.first),
            ("second", &self.adam.second),
        ];
        let tensors = parts.into_iter().flat_map(|(part, values)| {
            let stored = self.variables.specs().iter().zip(values);
            stored.map(move |(spec, values)| (format!("{part}.{}", spec.name), Stored::full(spec, values)))
        });
        let path = dir.join(CHECKPOINT_FILE);
        write_file(&path, tensors.collect(), METADATA_KEY, &json(&path, &metadata)?)?;
        let averaged = Variables::with_values(self.variables.config(), &self.average)?;
        write_weights(&averaged, Precision::Full, &dir.join(WEIGHTS_FILE))
    }

    /// The state of the checkpoint in `dir`, which is of the stage `expected`.
    ///
    /// # Errors
    /// When the file cannot be read, or is no checkpoint of this stage and version.
    pub fn read(dir: &Path, expected: StageName) -> Result<Self> {
        let path = dir.join(CHECKPOINT_FILE);
        let bytes = std::fs::read(&path).map_err(|source| FormatError::io(&path, "read", source))?;
        let fault = |field: &str, expected: &str, found: String| TrainError::Checkpoint {
            file: path.clone(),
            field: field.to_owned(),
            expected: expected.to_owned(),
            found,
        };
        let broken = |error: safetensors::SafeTensorError| fault("header", "a safetensors file", error.to_string());
        let (_, header) = SafeTensors::read_metadata(&bytes).map_err(broken)?;
        let text = header.metadata().as_ref().and_then(|metadata| metadata.get(METADATA_KEY));
        let text = text.ok_or_else(|| fault(METADATA_KEY, "a string", "nothing".to_owned()))?;
        let unclear = |error: serde_json::Error| fault(METADATA_KEY, FORMAT, error.to_string());
        let Stage { stage } = serde_json::from_str(text).map_err(unclear)?;
        let metadata: Metadata<S> = match serde_json::from_str(text) {
            Ok(metadata) => metadata,
            Err(_) if stage != expected => return Err(fault("stage", &format!("{expected:?}"), format!("{stage:?}"))),
            Err(error) => return Err(unclear(error)),
        };
        if stage != expected || metadata.settings.stage() != expected {
            return Err(fault("stage", &format!("{expected:?}"), format!("{stage:?}")));
        }
        if metadata.format != FORMAT {
            return Err(fault("format", FORMAT, metadata.format));
        }
        let config_text = json(&path, &metadata.config)?;
        let config = ModelConfig::parse(&config_text, &path)?;
        metadata.settings.validate()?;
        let content = SafeTensors::deserialize(&bytes).map_err(broken)?;
        let specs = Model::tensors(&config)?;
        let part = |part: &str| -> Result<Values> {
            specs.iter().map(|spec| tensor(&content, &format!("{part}.{}", spec.name), spec, &fault)).collect()
        };
        let adam = AdamW { first: part("first")?, second: part("second")?, updates: metadata.updates };
        Ok(Self {
            variables: Variables::with_values(&config, &part("weights")?)?,
            average: part("average")?,
            adam,
            settings: metadata.settings,
            step: metadata.step,
            skipped: metadata.skipped,
        })
    }
}

/// The values of a tensor that must have the shape of `spec` and be finite.
fn tensor(
    content: &SafeTensors<'_>,
    name: &str,
    spec: &TensorSpec,
    fault: &impl Fn(&str, &str, String) -> TrainError,
) -> Result<Vec<f32>> {
    let view = content.tensor(name).map_err(|error| fault(name, "a tensor", error.to_string()))?;
    if view.dtype() != Dtype::F32 || view.shape() != spec.shape {
        return Err(fault(name, &format!("F32 {:?}", spec.shape), format!("{:?} {:?}", view.dtype(), view.shape())));
    }
    let values: Vec<f32> = view.data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    match values.iter().find(|v| !v.is_finite()) {
        Some(found) => Err(fault(name, "finite values", found.to_string())),
        None => Ok(values),
    }
}
