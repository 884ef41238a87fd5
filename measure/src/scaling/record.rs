//! What was found of a size: one JSON file each, read again when the work goes on.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{
    measure::{Space, Times},
    plan::Size,
};
use crate::{
    error::Result,
    machine::Machine,
    records::{read_record, write_record},
};

/// The value of `format` in the file of a size.
pub const SIZE_FORMAT: &str = "lgs-scaling-size/2";

/// What decides the figures beside the size: a record of other causes is not used again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScalingKey {
    /// [`SIZE_FORMAT`].
    pub format: String,
    /// SHA-256 of the weights; `None` without a network.
    pub weights: Option<String>,
    /// Seed of everything that is drawn at random.
    pub seed: u64,
    /// Most timed runs.
    pub repeats: usize,
    /// What measured.
    pub machine: Machine,
}

/// Everything that was found of a size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SizeRecord {
    /// What decides it.
    pub key: ScalingKey,
    /// The size that was asked for.
    pub size: Size,
    /// Time.
    pub times: Times,
    /// Memory, and what there is to do.
    pub space: Space,
}

/// A size that could not be measured.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FailedSize {
    /// The size.
    pub size: String,
    /// Why not.
    pub reason: String,
}

impl SizeRecord {
    /// The file of a size.
    pub fn file(folder: &Path, size: &Size) -> PathBuf {
        folder.join(format!("{}_{}x{}.json", size.points, size.height, size.width))
    }

    /// The record in `file`; `None` where there is none, one that was not written to its end, or one of other key.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn read(file: &Path, key: &ScalingKey) -> Result<Option<Self>> {
        Ok(read_record(file)?.filter(|record: &Self| &record.key == key))
    }

    /// Writes the record into `file`.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, file: &Path) -> Result<()> {
        write_record(file, self)
    }
}
