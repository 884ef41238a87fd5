//! Where a model comes from: a weights file, or a config with seeded weights.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use lgs_formats::{digest::sha256, error::FormatError};
use safetensors::SafeTensors;

use super::config::ModelConfig;
use super::describe::thousands;
use super::model::Model;
use super::shipped;
use super::weights::{TensorSpec, WeightFile};
use crate::error::{EngineError, Result};

/// Key of a weights file's metadata that holds the model's config as JSON.
pub const CONFIG_KEY: &str = "config";

/// Parameters of the largest model that is made: a config may ask for far more than a memory holds.
const MAX_PARAMETERS: usize = 400_000_000;

/// A model ready to run, and the digest of the file that it came from.
#[derive(Clone, Debug)]
pub struct LoadedModel {
    /// The model.
    pub model: Model,
    /// SHA-256 of the weights file; for seeded weights `random:` and the SHA-256 of the config file.
    pub digest: String,
}

/// Where a user says that the network comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ModelSource {
    /// There is no network.
    None,
    /// The weights that ship inside the program.
    Shipped,
    /// A weights file.
    File(PathBuf),
    /// Drawn from a seed, in the sizes of a config file.
    Random(PathBuf),
}

impl ModelSource {
    /// The network, with seeded weights drawn from `seed`; none where there is none.
    ///
    /// # Errors
    /// Those of [`load_model`] and [`random_model`].
    pub fn load(&self, seed: u64) -> Result<Option<LoadedModel>> {
        match self {
            Self::None => Ok(None),
            Self::Shipped => shipped_model().map(Some),
            Self::File(file) => load_model(file).map(Some),
            Self::Random(config) => random_model(config, seed).map(Some),
        }
    }
}

impl FromStr for ModelSource {
    type Err = String;

    /// The source that `none`, `tiny`, `FILE` or `random:FILE` means.
    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match (text, text.strip_prefix("random:")) {
            ("none", _) => Ok(Self::None),
            (shipped::NAME, _) => Ok(Self::Shipped),
            ("", _) | (_, Some("")) => Err("expected none, tiny, a file, or random: and a file".to_owned()),
            (_, Some(config)) => Ok(Self::Random(config.into())),
            (file, None) => Ok(Self::File(file.into())),
        }
    }
}

/// The model that ships inside the program.
///
/// # Errors
/// When none does: there was no weights file when the program was built.
pub(crate) fn shipped_model() -> Result<LoadedModel> {
    let Some(bytes) = shipped::BYTES else {
        let expected = format!("a file, or none: this program was built without {}", shipped::FILE);
        return Err(EngineError::Setting { setting: "weights", expected, found: shipped::NAME.to_owned() });
    };
    model_of(&WeightFile::parse(shipped::FILE, bytes)?, Path::new(shipped::FILE))
}

/// The model of a weights file: safetensors whose metadata hold the config under [`CONFIG_KEY`].
///
/// # Errors
/// When the file cannot be read, its config is invalid, or its tensors are not the config's.
pub fn load_model(path: &Path) -> Result<LoadedModel> {
    model_of(&WeightFile::read(path)?, path)
}

fn model_of(file: &WeightFile, path: &Path) -> Result<LoadedModel> {
    let config = of_possible_size(ModelConfig::parse(file.metadata(CONFIG_KEY)?, path)?, path)?;
    Ok(LoadedModel { model: Model::load(&config, file)?, digest: file.sha256().to_owned() })
}

/// The model of a config file with weights drawn from `seed`.
///
/// # Errors
/// When the file is no valid config.
pub fn random_model(path: &Path, seed: u64) -> Result<LoadedModel> {
    let bytes = std::fs::read(path).map_err(|source| FormatError::io(path, "read", source))?;
    let Ok(text) = std::str::from_utf8(&bytes) else {
        return Err(FormatError::invalid(path, "content", "a model config", "bytes that are no text").into());
    };
    let config = of_possible_size(ModelConfig::parse(text, path)?, path)?;
    let digest = sha256(&bytes);
    Ok(LoadedModel { model: Model::random(&config, seed)?, digest: format!("random:{digest}") })
}

/// The config of a file that is either a config or a weights file.
///
/// # Errors
/// When it is neither.
pub fn config_of(path: &Path) -> Result<ModelConfig> {
    let bytes = std::fs::read(path).map_err(|source| FormatError::io(path, "read", source))?;
    if SafeTensors::read_metadata(&bytes).is_ok() {
        let file = WeightFile::parse(&path.display().to_string(), &bytes)?;
        return of_possible_size(ModelConfig::parse(file.metadata(CONFIG_KEY)?, path)?, path);
    }
    match std::str::from_utf8(&bytes) {
        Ok(text) => of_possible_size(ModelConfig::parse(text, path)?, path),
        Err(_) => Err(FormatError::invalid(path, "content", "a model config or a weights file", "neither").into()),
    }
}

/// The config, of a model that can be made.
///
/// # Errors
/// When the model has more than [`MAX_PARAMETERS`].
fn of_possible_size(config: ModelConfig, path: &Path) -> Result<ModelConfig> {
    let parameters: usize = Model::tensors(&config)?.iter().map(TensorSpec::len).sum();
    if parameters <= MAX_PARAMETERS {
        return Ok(config);
    }
    let expected = format!("at most {} parameters", thousands(MAX_PARAMETERS));
    Err(FormatError::invalid(path, "config", expected, thousands(parameters)).into())
}
