//! The one error type of this crate.

use std::path::PathBuf;

use lgs_engine::error::EngineError;
use lgs_formats::error::FormatError;
use lgs_targetgen::error::TargetError;

/// What went wrong.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A file could not be read or written, or says something wrong.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// The engine found something wrong.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// A tensor operation failed.
    #[error("tensor operation failed: {0}")]
    Tensor(#[from] candle_core::Error),
    /// A checkpoint is at fault.
    #[error("{}: {field}: expected {expected}, found {found}", file.display())]
    Checkpoint {
        /// The file.
        file: PathBuf,
        /// Tensor or metadata.
        field: String,
        /// What would have been right.
        expected: String,
        /// What was there.
        found: String,
    },
    /// A value of a configuration is out of its range.
    #[error("{field}: expected {expected}, found {found}")]
    Config {
        /// Path of the value, for example `rig.cameras[0].fov_deg`.
        field: String,
        /// What is allowed.
        expected: String,
        /// What was there.
        found: String,
    },
    /// A directory that is to be written holds something already.
    #[error("{}: expected a directory that does not exist or is empty, found files in it", dir.display())]
    NotEmpty {
        /// The directory.
        dir: PathBuf,
    },
    /// An image could not be encoded.
    #[error("{}: encode: {reason}", file.display())]
    Encode {
        /// The file.
        file: PathBuf,
        /// Why not.
        reason: String,
    },
}

impl From<TargetError> for TrainError {
    fn from(error: TargetError) -> Self {
        match error {
            TargetError::Engine(error) => Self::Engine(error),
            TargetError::Format(error) => Self::Format(error),
            TargetError::Setting { setting, expected, found } => Self::Config { field: setting, expected, found },
        }
    }
}

impl TrainError {
    /// A [`TrainError::Config`].
    pub fn config(field: impl Into<String>, expected: impl Into<String>, found: impl ToString) -> Self {
        Self::Config { field: field.into(), expected: expected.into(), found: found.to_string() }
    }

    /// The setting that does not fit; `None` where something else is wrong.
    pub fn setting(&self) -> Option<&str> {
        match self {
            Self::Config { field, .. } => Some(field),
            Self::Engine(error) => error.setting(),
            Self::Format(error) => error.setting(),
            _ => None,
        }
    }
}

/// Result of this crate's operations.
pub type Result<T> = std::result::Result<T, TrainError>;
