//! The engine's one error type.

use lgs_formats::error::FormatError;

/// Bytes.
const MEGABYTE: u64 = 1_000_000;

/// What can go wrong between a clip and its figures.
#[derive(Debug, thiserror::Error)]
pub enum EngineError {
    /// A file of the clip, or a file to write, is at fault.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// A setting does not fit the clip.
    #[error("{setting}: expected {expected}, found {found}")]
    Setting {
        /// Name of the setting: a flag of that name, where a program has one.
        setting: &'static str,
        /// What would have been right.
        expected: String,
        /// What was given.
        found: String,
    },
    /// There is not enough memory.
    #[error(
        "{setting}: expected {what} in the {} MB of memory that are free, found {found}, at least {} MB in all",
        .free / MEGABYTE, .need.div_ceil(MEGABYTE)
    )]
    TooLarge {
        /// Name of the setting that lowers the need.
        setting: &'static str,
        /// What would have been right, such as "views that can be drawn".
        what: &'static str,
        /// What was to be held.
        found: String,
        /// Bytes that it takes.
        need: u64,
        /// Bytes that there are.
        free: u64,
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

impl EngineError {
    /// The setting that does not fit; `None` where something else is wrong.
    pub fn setting(&self) -> Option<&str> {
        match self {
            Self::Setting { setting, .. } | Self::TooLarge { setting, .. } => Some(setting),
            Self::Format(error) => error.setting(),
            _ => None,
        }
    }
}

/// Result of the engine's operations.
pub type Result<T> = std::result::Result<T, EngineError>;
