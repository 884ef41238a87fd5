//! The one error type of this crate: names the file, the field, what was expected and what was found.

use std::path::{Path, PathBuf};

/// Longest field, expectation or finding, characters.
const MAX_PART: usize = 500;

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
    /// What was asked of a file or a folder does not fit it.
    #[error("{}: {setting}: expected {expected}, found {found}", file.display())]
    Setting {
        /// The file or folder.
        file: PathBuf,
        /// Name of the setting: a flag of that name, where a program has one.
        setting: &'static str,
        /// What would have been right.
        expected: String,
        /// What was asked for.
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
        let [field, expected, found] = [field.into(), expected.into(), found.into()].map(one_line);
        Self::Invalid { file: file.to_owned(), field, expected, found }
    }

    /// An [`FormatError::Setting`].
    pub fn unfit(file: &Path, setting: &'static str, expected: impl Into<String>, found: impl Into<String>) -> Self {
        let [expected, found] = [expected.into(), found.into()].map(one_line);
        Self::Setting { file: file.to_owned(), setting, expected, found }
    }

    /// The setting that does not fit; `None` where something else is wrong.
    pub const fn setting(&self) -> Option<&str> {
        match self {
            Self::Setting { setting, .. } => Some(setting),
            _ => None,
        }
    }

    /// An [`FormatError::Syntax`].
    pub fn syntax(file: &Path, field: impl Into<String>, message: impl Into<String>) -> Self {
        Self::Syntax { file: file.to_owned(), field: one_line(field.into()), message: one_line(message.into()) }
    }
}

/// The text without control characters and of bounded length: parts of it come from the file itself.
fn one_line(text: String) -> String {
    if text.len() <= MAX_PART && !text.contains(char::is_control) {
        return text;
    }
    let mut line: String = text.chars().take(MAX_PART).map(|c| if c.is_control() { ' ' } else { c }).collect();
    if text.len() > MAX_PART {
        line.push_str("...");
    }
    line
}

/// Result of this crate's operations.
pub type Result<T> = std::result::Result<T, FormatError>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_is_one_line_of_bounded_length() {
        let error = FormatError::invalid(Path::new("f"), "a\nb", "x", "y\r\n\u{1b}[31m".repeat(1000));
        let message = error.to_string();
        assert!(!message.contains(char::is_control), "{message}");
        assert!(message.starts_with("f: a b: expected x, found y") && message.len() < 600, "{message}");
    }
}
