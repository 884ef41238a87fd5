//! Where things are: the repository, the optional data beside it, where pictures of failures go.

use std::env;
use std::path::{Path, PathBuf};

/// The repository's root.
pub fn repository() -> &'static Path {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR"));
    tests.parent().unwrap_or(tests)
}

/// Data that is too large or not free to ship: `$LGS_SHARED_DIR`, or `shared` beside the repository.
pub fn shared() -> PathBuf {
    env::var_os("LGS_SHARED_DIR").map_or_else(|| repository().join("../shared"), PathBuf::from)
}

/// The LPIPS weights: `$LGS_LPIPS_WEIGHTS`, or the file in [`shared`].
pub fn lpips_weights() -> PathBuf {
    let usual = || shared().join("weights/lpips_squeeze_v0.1.safetensors");
    env::var_os("LGS_LPIPS_WEIGHTS").map_or_else(usual, PathBuf::from)
}

/// A Python interpreter with plyfile and gsply: `$LGS_PYTHON`.
pub fn python_with_readers() -> Option<PathBuf> {
    env::var_os("LGS_PYTHON").map(PathBuf::from)
}

/// The directory of one kind of goldens that the repository ships.
pub fn shipped_goldens(kind: &str) -> PathBuf {
    repository().join("tests/golden").join(kind)
}

/// The directory of one kind of goldens that `$LGS_GOLDEN_DIR` brings, in the layout of the shipped ones.
pub fn given_goldens(kind: &str) -> Option<PathBuf> {
    env::var_os("LGS_GOLDEN_DIR").map(|dir| PathBuf::from(dir).join(kind))
}

/// Where a failing case leaves its pictures.
pub fn failures() -> PathBuf {
    env::temp_dir().join("lgs-test-failures")
}
