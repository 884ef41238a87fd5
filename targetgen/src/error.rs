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
        /// Name of the setting: a flag of that name, where a program has one, or a variable of the environment.
        setting: String,
        /// What would have been right.
        expected: String,
        /// What was given.
        found: String,
    },
}

impl TargetError {
    /// A [`TargetError::Setting`].
    pub fn unfit(setting: impl Into<String>, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self::Setting { setting: setting.into(), expected: expected.into(), found: found.into() }
    }

    /// The setting that does not fit; `None` where something else is wrong.
    pub fn setting(&self) -> Option<&str> {
        match self {
            Self::Setting { setting, .. } => Some(setting),
            Self::Engine(error) => error.setting(),
            Self::Format(error) => error.setting(),
        }
    }
}

/// Result of this crate's operations.
pub type Result<T> = std::result::Result<T, TargetError>;
