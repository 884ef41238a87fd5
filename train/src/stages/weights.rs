//! Weights files: read to start from, written for inference.

use std::{borrow::Cow, collections::HashMap, path::Path};

use candle_core::DType;
use candle_nn::var_builder::SimpleBackend;
use half::f16;
use lgs_engine::{
    network::{
        config::ModelConfig,
        model::Model,
        source::CONFIG_KEY,
        weights::{TensorSpec, WeightFile},
    },
    ops::DEVICE,
};
use lgs_formats::write::write_atomic;
use safetensors::{Dtype, View};
use serde::Serialize;

use super::variables::{Values, Variables};
use crate::error::{Result, TrainError};

/// How many bits a weights file spends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// 32 of every value.
    Full,
    /// 16 of what convolutions and linear layers multiply by; biases and all of normalisation, which are few, keep 32.
    Half,
}

/// A weights file's content, and its digest.
#[derive(Debug)]
pub struct StartWeights {
    /// The weights.
    pub variables: Variables,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
}

/// A tensor on its way into a file.
#[derive(Debug)]
pub(crate) struct Stored<'a> {
    shape: &'a [usize],
    values: &'a [f32],
    precision: Precision,
}

impl<'a> Stored<'a> {
    /// All bits of all values.
    pub(crate) fn full(spec: &'a TensorSpec, values: &'a [f32]) -> Self {
        Self { shape: &spec.shape, values, precision: Precision::Full }
    }
}

impl View for Stored<'_> {
    fn dtype(&self) -> Dtype {
        match self.precision {
            Precision::Full => Dtype::F32,
            Precision::Half => Dtype::F16,
        }
    }

    fn shape(&self) -> &[usize] {
        self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        match self.precision {
            Precision::Full => self.values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>().into(),
            Precision::Half => {
                self.values.iter().flat_map(|&v| f16::from_f32(v).to_le_bytes()).collect::<Vec<u8>>().into()
            }
        }
    }

    fn data_len(&self) -> usize {
        match self.precision {
            Precision::Full => 4 * self.values.len(),
            Precision::Half => 2 * self.values.len(),
        }
    }
}

impl StartWeights {
    /// The content of a weights file, which is checked as a whole.
    ///
    /// # Errors
    /// When the file cannot be read, its config is invalid, or its tensors are not the config's.
    pub fn read(path: &Path) -> Result<Self> {
        let file = WeightFile::read(path)?;
        let config = ModelConfig::parse(file.metadata(CONFIG_KEY)?, path)?;
        let specs = Model::tensors(&config)?;
        file.check(&specs)?;
        let value =
            |spec: &TensorSpec| file.get_unchecked(&spec.name, DType::F32, &DEVICE)?.flatten_all()?.to_vec1::<f32>();
        let values: Values = specs.iter().map(value).collect::<candle_core::Result<_>>()?;
        let variables = Variables::with_values(&config, &values)?;
        Ok(Self { variables, sha256: file.sha256().to_owned() })
    }
}

/// Writes the weights into `path`, as inference loads them.
///
/// # Errors
/// When a value is too large for its bits, or the file cannot be written.
pub fn write_weights(variables: &Variables, precision: Precision, path: &Path) -> Result<()> {
    let values = variables.values()?;
    let stored = |(spec, values): (&'_ TensorSpec, &'_ Vec<f32>)| -> Result<()> {
        let too_large = |v: &&f32| !f16::from_f32(**v).is_finite();
        match values.iter().find(too_large) {
            Some(found) if of_half(spec, precision) => {
                Err(TrainError::config(&spec.name, "values that 16 bits hold", found))
            }
            _ => Ok(()),
        }
    };
    variables.specs().iter().zip(&values).try_for_each(stored)?;
    let tensors = variables.specs().iter().zip(&values).map(|(spec, values)| {
        let precision = if of_half(spec, precision) { Precision::Half } else { Precision::Full };
        (spec.name.clone(), Stored { shape: &spec.shape, values, precision })
    });
    write_file(path, tensors.collect(), CONFIG_KEY, &json(path, variables.config())?)
}

fn of_half(spec: &TensorSpec, precision: Precision) -> bool {
    precision == Precision::Half && spec.shape.len() > 1
}

pub(crate) fn json(path: &Path, value: &impl Serialize) -> Result<String> {
    let failed = |error: serde_json::Error| TrainError::Encode { file: path.to_owned(), reason: error.to_string() };
    serde_json::to_string(value).map_err(failed)
}

pub(crate) fn write_file(path: &Path, tensors: Vec<(String, Stored<'_>)>, key: &str, text: &str) -> Result<()> {
    let metadata = HashMap::from([(key.to_owned(), text.to_owned())]);
    let failed =
        |error: safetensors::SafeTensorError| TrainError::Encode { file: path.to_owned(), reason: error.to_string() };
    let bytes = safetensors::serialize(tensors, Some(metadata)).map_err(failed)?;
    Ok(write_atomic(path, &bytes)?)
}
