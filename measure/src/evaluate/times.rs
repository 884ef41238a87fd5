//! What snippets took: it differs from run to run, so it stands apart from the figures, a file a snippet.

use std::{
    fs,
    path::{Path, PathBuf},
};

use lgs_engine::render::DrawnOn;
use lgs_formats::{error::FormatError, jobs};
use serde::{Deserialize, Serialize};

use crate::{
    error::Result,
    records::{read_record, write_record},
};

/// Folder of the times of snippets.
const TIMES: &str = "times";

/// What a snippet took when it was done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SnippetTimes {
    /// Seconds until the input views were loaded.
    pub load_s: f64,
    /// Seconds from the loaded input views to the finished scene, of each recipe.
    pub reconstruction_s: Vec<f64>,
    /// Seconds of loading, drawing and measuring the target views, of all recipes.
    pub evaluate_s: f64,
    /// Largest resident memory of the process until then, 10^6 bytes; `None` where the system does not say.
    pub peak_rss_mb: Option<f64>,
    /// Threads that worked.
    pub threads: usize,
    /// Where views were drawn while each recipe made its scene, and why not where that was asked for.
    #[serde(default)]
    pub drawn_on: Vec<DrawnOn>,
}

fn file(out: &Path, item: &str) -> PathBuf {
    out.join(TIMES).join(format!("{item}.json"))
}

/// Keeps what a snippet took.
///
/// # Errors
/// A folder that cannot be written to.
pub fn keep(out: &Path, item: &str, times: &SnippetTimes) -> Result<()> {
    let folder = out.join(TIMES);
    fs::create_dir_all(&folder).map_err(|e| FormatError::io(&folder, "create", e))?;
    write_record(&file(out, item), times)
}

/// Removes what an interrupted write left.
///
/// # Errors
/// A folder that cannot be read or written to.
pub fn remove_unfinished(out: &Path) -> Result<()> {
    Ok(jobs::remove_unfinished(&out.join(TIMES))?)
}

/// What a snippet took; `None` where that is not known.
///
/// # Errors
/// A file that cannot be read.
pub fn read(out: &Path, item: &str) -> Result<Option<SnippetTimes>> {
    Ok(read_record(&file(out, item))?)
}

/// Brings the times of the parts in `folders` to `out`.
///
/// # Errors
/// Files that cannot be read or written.
pub fn merge(folders: &[PathBuf], out: &Path, items: &[String]) -> Result<()> {
    for (folder, item) in folders.iter().flat_map(|folder| items.iter().map(move |item| (folder, item))) {
        if let Some(times) = read(folder, item)?.filter(|_| folder != out) {
            keep(out, item, &times)?;
        }
    }
    Ok(())
}
