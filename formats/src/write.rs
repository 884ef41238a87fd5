//! Atomic writes: temporary name in the same directory, sync, rename.

use std::{io::Write, path::Path};

use crate::{
    error::{FormatError, Result},
    unfinished::Unfinished,
};

pub use crate::unfinished::observe_writing;

/// Writes a file: afterwards `path` holds exactly `bytes`, or, on an error, what it held before.
///
/// The directory of `path` must exist.
///
/// # Errors
/// [`FormatError::Io`] when the directory cannot be written to; a path that is a device or a pipe.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomic_with(path, |file| file.write_all(bytes).map_err(|e| FormatError::io(path, "write", e)))
}

/// As [`write_atomic`], for content that `fill` writes piece by piece.
///
/// # Errors
/// Those of [`write_atomic`], and whatever `fill` says.
pub fn write_atomic_with<T>(path: &Path, fill: impl FnOnce(&mut std::fs::File) -> Result<T>) -> Result<T> {
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    if std::fs::metadata(path).is_ok_and(|old| !old.is_file() && !old.is_dir()) {
        // The rename would put a plain file where a device or a pipe was.
        return Err(FormatError::invalid(path, "file type", "a new or a regular file", "a special file"));
    }
    let mut builder = tempfile::Builder::new();
    builder.prefix(".lgs-").suffix(".part");
    #[cfg(unix)]
    let permissions = <std::fs::Permissions as std::os::unix::fs::PermissionsExt>::from_mode(0o666);
    #[cfg(unix)]
    builder.permissions(permissions); // the umask takes its share, as for any new file
    let _unfinished = Unfinished::new();
    let mut file = builder.tempfile_in(directory).map_err(|e| FormatError::io(path, "create", e))?;
    let value = fill(file.as_file_mut())?;
    file.as_file().sync_all().map_err(|e| FormatError::io(path, "sync", e))?;
    file.persist(path).map_err(|e| FormatError::io(path, "rename to", e.error))?;
    Ok(value)
}

/// Fails unless files can be made in `directory`; none is left there.
///
/// # Errors
/// [`FormatError::Io`] when not.
pub fn check_writable(directory: &Path) -> Result<()> {
    tempfile::tempfile_in(directory).map(drop).map_err(|e| FormatError::io(directory, "write into", e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replaces_the_content_and_leaves_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        write_atomic(&path, b"first, and longer").unwrap();
        write_atomic(&path, b"second").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"second");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_failed_write_leaves_the_old_content_and_no_temporary() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("occupied");
        std::fs::create_dir(&path).unwrap();
        std::fs::write(path.join("kept"), b"kept").unwrap();
        let message = write_atomic(&path, b"bytes").unwrap_err().to_string();
        assert!(message.contains("occupied: rename to"), "{message}");
        assert_eq!(std::fs::read(path.join("kept")).unwrap(), b"kept");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_missing_directory_is_an_error_that_names_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let message = write_atomic(&dir.path().join("no/such.bin"), b"").unwrap_err().to_string();
        assert!(message.contains("such.bin: create: "), "{message}");
    }

    #[cfg(unix)]
    #[test]
    fn what_is_no_plain_file_stays_what_it_is() {
        use std::os::unix::net::UnixListener;
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("socket");
        let _listener = UnixListener::bind(&path).unwrap();
        let message = write_atomic(&path, b"bytes").unwrap_err().to_string();
        assert!(
            message.ends_with("socket: file type: expected a new or a regular file, found a special file"),
            "{message}"
        );
        assert!(!std::fs::metadata(&path).unwrap().is_file());
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn whether_a_directory_takes_files_is_known_without_one() {
        let dir = tempfile::tempdir().unwrap();
        check_writable(dir.path()).unwrap();
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
        let message = check_writable(&dir.path().join("none")).unwrap_err().to_string();
        assert!(message.contains("none: write into: "), "{message}");
    }

    #[cfg(unix)]
    #[test]
    fn a_new_file_can_be_read_by_others_as_the_umask_says() {
        use std::os::unix::fs::PermissionsExt;
        let dir = tempfile::tempdir().unwrap();
        let mode = |name: &str| std::fs::metadata(dir.path().join(name)).unwrap().permissions().mode();
        write_atomic(&dir.path().join("ours"), b"").unwrap();
        std::fs::write(dir.path().join("plain"), b"").unwrap();
        assert_eq!(mode("ours"), mode("plain"));
    }
}
