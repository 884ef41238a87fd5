//! The one error type of this crate.

use std::path::PathBuf;

use lgs_formats::error::FormatError;

/// What went wrong.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A file could not be read or written, or says something wrong.
    #[error(transparent)]
    Format(#[from] FormatError),
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

impl TrainError {
    /// A [`TrainError::Config`].
    pub fn config(field: impl Into<String>, expected: impl Into<String>, found: impl ToString) -> Self {
        Self::Config { field: field.into(), expected: expected.into(), found: found.to_string() }
    }
}

/// Result of this crate's operations.
pub type Result<T> = std::result::Result<T, TrainError>;
