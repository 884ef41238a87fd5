//! The one error type of this crate: names the file, the field, what was expected and what was found.

use std::path::{Path, PathBuf};

/// What is wrong with a file.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// The operating system refused.
    #[error("{}: {action}: {source}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// What was tried: "read", "write", ...
        action: &'static str,
        /// Why it failed.
        source: std::io::Error,
    },
    /// The content is not what the format asks for.
    #[error("{}: {field}: expected {expected}, found {found}", file.display())]
    Invalid {
        /// The file.
        file: PathBuf,
        /// Path of the field, for example `frames[0].lidar.timestamp`.
        field: String,
        /// What the format asks for.
        expected: String,
        /// What was there.
        found: String,
    },
    /// The text cannot be parsed, or holds keys or types that the format does not know.
    #[error("{}: {field}: {message}", file.display())]
    Syntax {
        /// The file.
        file: PathBuf,
        /// Path of the field with its line, for example `frames[0].lidar (line 7)`.
        field: String,
        /// The parser's own sentence.
        message: String,
    },
}

impl FormatError {
    /// An [`FormatError::Io`].
    pub fn io(file: &Path, action: &'static str, source: std::io::Error) -> Self {
        Self::Io { file: file.to_owned(), action, source }
    }

    /// An [`FormatError::Invalid`].
    pub fn invalid(
        file: &Path,
        field: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Invalid { file: file.to_owned(), field: field.into(), expected: expected.into(), found: found.into() }
    }
}

/// Result of this crate's operations.
pub type Result<T> = std::result::Result<T, FormatError>;
