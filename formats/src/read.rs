//! Bounded reads of untrusted files.

use std::{fs::File, io::Read, path::Path};

use crate::error::{FormatError, Result};

/// Largest sweep, image, mask or splat cloud that is read, bytes.
pub(crate) const MAX_DATA_BYTES: u64 = 4 << 30;

/// The size of a regular file, bytes.
///
/// # Errors
/// The file is missing, is no regular file (a pipe would block the reader), or is larger than `max_bytes`.
pub(crate) fn file_size(path: &Path, max_bytes: u64) -> Result<u64> {
    let metadata = std::fs::metadata(path).map_err(|e| FormatError::io(path, "read", e))?;
    if !metadata.is_file() {
        let found = if metadata.is_dir() { "a directory" } else { "a special file" };
        return Err(FormatError::invalid(path, "file type", "a regular file", found));
    }
    if metadata.len() > max_bytes {
        let found = format!("{} bytes", metadata.len());
        return Err(FormatError::invalid(path, "file size", format!("at most {max_bytes} bytes"), found));
    }
    Ok(metadata.len())
}

/// The bytes of a regular file of at most `max_bytes`.
///
/// # Errors
/// Those of [`file_size`], and a file that cannot be read.
pub(crate) fn read_file(path: &Path, max_bytes: u64) -> Result<Vec<u8>> {
    let size = file_size(path, max_bytes)?;
    let file = File::open(path).map_err(|e| FormatError::io(path, "read", e))?;
    let mut bytes = Vec::with_capacity(usize::try_from(size).unwrap_or(0));
    file.take(max_bytes).read_to_end(&mut bytes).map_err(|e| FormatError::io(path, "read", e))?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_within_the_limit_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        std::fs::write(&path, b"12345").unwrap();
        assert_eq!(read_file(&path, 5).unwrap(), b"12345");
        let message = read_file(&path, 4).unwrap_err().to_string();
        assert!(message.ends_with("a: file size: expected at most 4 bytes, found 5 bytes"), "{message}");
        let message = read_file(dir.path(), 4).unwrap_err().to_string();
        assert!(message.ends_with("expected a regular file, found a directory"), "{message}");
        assert!(matches!(read_file(&dir.path().join("b"), 4), Err(FormatError::Io { .. })));
    }
}
