//! Checkpoints: everything that a run needs to go on as if it had never stopped, and the weights for inference.

use std::{borrow::Cow, collections::HashMap, path::Path};

use lgs_engine::network::{config::ModelConfig, model::Model, source::CONFIG_KEY, weights::TensorSpec};
use lgs_formats::{error::FormatError, write::write_atomic};
use safetensors::{Dtype, SafeTensors, View};
use serde::{Deserialize, Serialize};

use super::{
    adamw::AdamW,
    settings::Settings,
    variables::{Values, Variables},
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
pub struct State {
    /// Settings of the run.
    pub settings: Settings,
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
struct Metadata {
    format: String,
    config: ModelConfig,
    settings: Settings,
    step: u64,
    updates: u64,
    skipped: u64,
}

struct Stored<'a> {
    shape: &'a [usize],
    values: &'a [f32],
}

impl View for Stored<'_> {
    fn dtype(&self) -> Dtype {
        Dtype::F32
    }

    fn shape(&self) -> &[usize] {
        self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        self.values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>().into()
    }

    fn data_len(&self) -> usize {
        4 * self.values.len()
    }
}

impl State {
    /// The start of a run.
    ///
    /// # Errors
    /// When a setting is out of its range.
    pub fn new(config: &ModelConfig, settings: Settings) -> Result<Self> {
        settings.validate()?;
        let variables = Variables::seeded(config, settings.seed)?;
        let (adam, average) = (AdamW::new(&variables), variables.values()?);
        Ok(Self { settings, step: 0, skipped: 0, variables, average, adam })
    }

    /// Nothing: afterwards `dir` holds the checkpoint and the weights of this state, each written as a whole.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, dir: &Path) -> Result<()> {
        let metadata = Metadata {
            format: FORMAT.to_owned(),
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
            stored.map(move |(spec, values)| (format!("{part}.{}", spec.name), Stored { shape: &spec.shape, values }))
        });
        let path = dir.join(CHECKPOINT_FILE);
        write_file(&path, tensors.collect(), METADATA_KEY, &json(&path, &metadata)?)?;
        self.write_weights(&dir.join(WEIGHTS_FILE))
    }

    /// Nothing: afterwards `path` holds the average of the weights, as inference loads it.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_weights(&self, path: &Path) -> Result<()> {
        let stored = self.variables.specs().iter().zip(&self.average);
        let tensors = stored.map(|(spec, values)| (spec.name.clone(), Stored { shape: &spec.shape, values }));
        write_file(path, tensors.collect(), CONFIG_KEY, &json(path, self.variables.config())?)
    }

    /// The state of the checkpoint in `dir`.
    ///
    /// # Errors
    /// When the file cannot be read, or is no checkpoint of a model of this version.
    pub fn read(dir: &Path) -> Result<Self> {
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
        let metadata: Metadata =
            serde_json::from_str(text).map_err(|error| fault(METADATA_KEY, FORMAT, error.to_string()))?;
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

fn json(path: &Path, value: &impl Serialize) -> Result<String> {
    let failed = |error: serde_json::Error| TrainError::Encode { file: path.to_owned(), reason: error.to_string() };
    serde_json::to_string(value).map_err(failed)
}

fn write_file(path: &Path, tensors: Vec<(String, Stored<'_>)>, key: &str, text: &str) -> Result<()> {
    let metadata = HashMap::from([(key.to_owned(), text.to_owned())]);
    let failed =
        |error: safetensors::SafeTensorError| TrainError::Encode { file: path.to_owned(), reason: error.to_string() };
    let bytes = safetensors::serialize(tensors, Some(metadata)).map_err(failed)?;
    Ok(write_atomic(path, &bytes)?)
}
