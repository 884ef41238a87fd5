//! This crate's one error type.

use lgs_engine::error::EngineError;
use lgs_formats::error::FormatError;

/// What can go wrong between clips and shards.
#[derive(Debug, thiserror::Error)]
pub enum TargetError {
    /// A clip or its scene is at fault.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// A file to read or to write is at fault.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// A setting does not fit.
    #[error("{setting}: expected {expected}, found {found}")]
    Setting {
        /// Name of the setting, as the user knows it: a flag or a variable of the environment.
        setting: String,
        /// What would have been right.
        expected: String,
        /// What was given.
        found: String,
    },
}

impl TargetError {
    /// A [`TargetError::Setting`].
    pub fn setting(setting: impl Into<String>, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self::Setting { setting: setting.into(), expected: expected.into(), found: found.into() }
    }
}

/// Result of this crate's operations.
pub type Result<T> = std::result::Result<T, TargetError>;
