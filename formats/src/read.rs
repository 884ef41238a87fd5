//! Bounded reads of untrusted files.

use std::{fs::File, io::Read, path::Path};

use crate::error::{FormatError, Result};

/// Largest sweep, image, mask or splat cloud that is read, bytes.
pub(crate) const MAX_DATA_BYTES: u64 = 4 << 30;

/// Bytes that any packed file may unfold to: several times a sweep of any sensor, which unfold 1.5 to 3 times; what is made to fill a memory
/// does so 1000 times.
const UNPACKED_BYTES: u64 = 16 << 20;

/// Most bytes that a packed file, or part of one, of `packed` bytes may unfold to.
///
/// What is read of them takes three times as much at most, so that no input takes more memory than 64 MB and four times its size.
pub(crate) const fn unpacked_limit(packed: u64) -> u64 {
    packed.saturating_add(packed / 3).saturating_add(UNPACKED_BYTES)
}

/// What `reader` unfolds of a file of `packed` bytes; `kind` is what errors call the packing.
///
/// # Errors
/// Bytes that are damaged, or that unfold to more than [`unpacked_limit`].
pub(crate) fn read_unpacked(path: &Path, kind: &str, packed: u64, reader: impl Read) -> Result<Vec<u8>> {
    let limit = unpacked_limit(packed);
    let mut bytes = Vec::new();
    let unpacked = reader.take(limit.saturating_add(1)).read_to_end(&mut bytes);
    unpacked.map_err(|e| FormatError::syntax(path, kind, format!("{e} (truncated?)")))?;
    if bytes.len() as u64 > limit {
        let expected = format!("at most {limit} bytes unpacked from {packed}");
        return Err(FormatError::invalid(path, kind, expected, "more"));
    }
    Ok(bytes)
}

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
