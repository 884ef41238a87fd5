//! The one error type of this crate.

use lgs_engine::error::EngineError;
use lgs_formats::error::FormatError;
use lgs_train::error::TrainError;

/// What went wrong.
#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    /// A file could not be read or written, or says something wrong.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// The engine found something wrong.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// A clip could not be opened as it was asked for.
    #[error(transparent)]
    Train(Box<TrainError>),
    /// A setting is out of its range, or does not fit the others.
    #[error("{setting}: expected {expected}, found {found}")]
    Setting {
        /// Name of the setting: a flag of that name, where a program has one.
        setting: &'static str,
        /// What would have been right.
        expected: String,
        /// What was given.
        found: String,
    },
    /// A picture could not be encoded.
    #[error("{what}: encode: {source}")]
    Encode {
        /// The picture.
        what: String,
        /// Why not.
        source: image::ImageError,
    },
    /// What was measured could not be written as JSON, or not be read.
    #[error("{what}: {source}")]
    Json {
        /// The page.
        what: &'static str,
        /// Why not.
        source: serde_json::Error,
    },
    /// A configuration could not be measured.
    #[error("{0}")]
    Point(String),
}

impl From<TrainError> for MeasureError {
    fn from(error: TrainError) -> Self {
        Self::Train(Box::new(error))
    }
}

/// Result of this crate's operations.
pub type Result<T> = std::result::Result<T, MeasureError>;

impl MeasureError {
    /// A [`MeasureError::Setting`].
    pub fn unfit(setting: &'static str, expected: impl Into<String>, found: impl ToString) -> Self {
        Self::Setting { setting, expected: expected.into(), found: found.to_string() }
    }

    /// The setting that does not fit; `None` where something else is wrong.
    pub fn setting(&self) -> Option<&str> {
        match self {
            Self::Setting { setting, .. } => Some(setting),
            Self::Engine(error) => error.setting(),
            Self::Format(error) => error.setting(),
            Self::Train(error) => error.setting(),
            _ => None,
        }
    }
}
