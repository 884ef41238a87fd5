//! The engine's one error type.

use lgs_formats::error::FormatError;

/// What can go wrong between a clip and its figures.
#[derive(Debug, thiserror::Error)]
pub enum EngineError {
    /// A file of the clip, or a file to write, is at fault.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// A setting does not fit the clip.
    #[error("{setting}: expected {expected}, found {found}")]
    Setting {
        /// Name of the setting, as the user knows it (a flag).
        setting: &'static str,
        /// What would have been right.
        expected: String,
        /// What was given.
        found: String,
    },
    /// A weights file is at fault.
    #[error("{file}: {field}: expected {expected}, found {found}")]
    Weights {
        /// The file.
        file: String,
        /// Tensor or header field.
        field: String,
        /// What would have been right.
        expected: String,
        /// What was there.
        found: String,
    },
    /// A value that must be finite is not.
    #[error("{what}: expected a finite value, found {found}")]
    NonFinite {
        /// What was computed or read, with its index.
        what: String,
        /// The value.
        found: f32,
    },
    /// Something held out came where only inputs may be; a fault of this program, not of the clip.
    #[error("frame {frame} is held out, yet it was about to reach the reconstruction")]
    Leak {
        /// Index of the frame in the clip.
        frame: usize,
    },
    /// A tensor operation failed.
    #[error("tensor operation failed: {0}")]
    Tensor(#[from] candle_core::Error),
}

/// Result of the engine's operations.
pub type Result<T> = std::result::Result<T, EngineError>;
