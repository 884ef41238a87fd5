//! What runs find of the clip that ships, at half its size: each is run once, for all cases that compare others with it.

use std::{ffi::OsStr, path::Path, sync::OnceLock};

use lgs_tests::process::{binary, run};
use lgs_tests::{clips, metrics, places};
use serde_json::Value;

/// Half the size of its images: enough to compare runs, in a third of the time.
pub(crate) const HALF_SIZE: [&str; 2] = ["--image-size", "96x160"];

/// `metrics.json` of a run of the clip with odd frames held out, by the network that ships.
pub(crate) fn with_network() -> Result<&'static Value, String> {
    static FOUND: OnceLock<Result<Value, String>> = OnceLock::new();
    once(&FOUND, "tiny")
}

/// The same without a network.
pub(crate) fn without_network() -> Result<&'static Value, String> {
    static FOUND: OnceLock<Result<Value, String>> = OnceLock::new();
    once(&FOUND, "none")
}

fn once(found: &'static OnceLock<Result<Value, String>>, weights: &str) -> Result<&'static Value, String> {
    found.get_or_init(|| half_size_of(&clips::street(), &["--weights", weights])).as_ref().map_err(Clone::clone)
}

/// As [`found_of`], of the clip or one that was made of it.
pub(crate) fn half_size_of(clip: &Path, flags: &[&str]) -> Result<Value, String> {
    found_of(clip, &[&HALF_SIZE, flags].concat())
}

/// `metrics.json` of a run of a clip with odd frames held out.
pub(crate) fn found_of(clip: &Path, flags: &[&str]) -> Result<Value, String> {
    let out = tempfile::tempdir().map_err(|error| error.to_string())?;
    let mut arguments: Vec<&OsStr> = vec![clip.as_os_str(), "--out".as_ref(), out.path().as_os_str()];
    arguments.extend(["--hold-out", "odd"].iter().chain(flags).map(|flag| -> &OsStr { flag.as_ref() }));
    let finished = run(&binary("lgs-infer")?, &arguments, places::repository())?;
    finished.expect_success().map_err(|failed| failed.message().unwrap_or_default().to_owned())?;
    metrics::read(out.path())
}
