//! What was found on a clip: one JSON file each, written after every run, read again when the work goes on.

use std::path::{Path, PathBuf};

use lgs_formats::error::FormatError;
use serde::{Deserialize, Serialize};

use super::{
    budget_run::BudgetRun,
    case::Work,
    measure::{Accuracy, Cost},
    setting::Setting,
};
use crate::{
    clips::RecordedChoice,
    error::Result,
    machine::Machine,
    records::{read_record, write_record},
};

/// The value of `format` in the file of a clip.
pub const CLIP_FORMAT: &str = "lgs-sweep-clip/4";
/// Folder of the crops.
const CROPS: &str = "crops";

/// What decides the figures of a clip beside the configurations: a record of other causes is not used again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SweepKey {
    /// [`CLIP_FORMAT`].
    pub format: String,
    /// Where the clip says that it comes from.
    pub source: String,
    /// How it was read.
    pub choice: RecordedChoice,
    /// SHA-256 of the weights of LPIPS; `None` where it is not measured.
    pub lpips: Option<String>,
    /// Seed of everything that is drawn at random.
    pub seed: u64,
    /// What measured.
    pub machine: Machine,
}

/// One timed run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Repeat {
    /// Which start of the program measured it: runs of one session stand beside each other in time.
    pub session: usize,
    /// What it took.
    pub cost: Cost,
}

/// A configuration on a clip.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointRecord {
    /// The configuration.
    pub setting: Setting,
    /// What it is worth.
    pub accuracy: Accuracy,
    /// Largest resident memory of a process that loads the clip and runs this configuration alone, 10^6 bytes.
    pub peak_rss_mb: Option<f64>,
    /// File of a part of a held-out view as it was drawn, beside the record's folder.
    pub crop: Option<String>,
    /// Timed runs.
    pub repeats: Vec<Repeat>,
}

/// A configuration that could not be measured.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Failed {
    /// Name of the clip.
    pub clip: String,
    /// Its name.
    pub name: String,
    /// Why not.
    pub reason: String,
}

/// Everything that was found on a clip.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SweepRecord {
    /// What decides it.
    pub key: SweepKey,
    /// Name of the clip.
    pub clip: String,
    /// How much there is to do.
    pub work: Work,
    /// Seconds of loading the input views, in the last session that loaded them; `None` before.
    pub load_s: Option<f64>,
    /// File of the part of the held-out view that crops show, as the camera saw it.
    pub truth: Option<String>,
    /// Sessions so far.
    pub sessions: usize,
    /// The configurations, those of earlier grids too.
    pub points: Vec<PointRecord>,
    /// Runs with time budgets.
    pub budget_runs: Vec<BudgetRun>,
}

impl SweepRecord {
    /// The record in `file`; `None` where there is none, one that was not written to its end, or one of other key.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn read(file: &Path, key: &SweepKey) -> Result<Option<Self>> {
        Ok(read_record(file)?.filter(|record: &Self| &record.key == key))
    }

    /// Writes the record into `file`.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, file: &Path) -> Result<()> {
        write_record(file, self)
    }

    /// A configuration that was measured.
    pub fn point(&self, setting: &Setting) -> Option<&PointRecord> {
        self.points.iter().find(|point| &point.setting == setting)
    }

    /// Timed runs of a configuration so far.
    pub fn num_repeats(&self, setting: &Setting) -> usize {
        self.point(setting).map_or(0, |point| point.repeats.len())
    }

    /// Runs with a time budget so far.
    pub fn runs_of_budget(&self, budget_s: f64) -> impl Iterator<Item = &BudgetRun> {
        self.budget_runs.iter().filter(move |run| run.budget_s.total_cmp(&budget_s).is_eq())
    }

    /// Puts a point into the record, in the place of an older one of the same configuration.
    pub fn put(&mut self, point: PointRecord) {
        match self.points.iter_mut().find(|old| old.setting == point.setting) {
            Some(old) => *old = point,
            None => self.points.push(point),
        }
    }

    /// Adds a timed run of a configuration that has a point.
    pub fn add_repeat(&mut self, setting: &Setting, cost: Cost) {
        let session = self.sessions;
        if let Some(point) = self.points.iter_mut().find(|point| &point.setting == setting) {
            point.repeats.push(Repeat { session, cost });
        }
    }
}

/// The bytes of a crop.
///
/// # Errors
/// When it cannot be read.
pub fn read_crop(out: &Path, name: &str) -> Result<Vec<u8>> {
    let file = out.join(CROPS).join(name);
    Ok(std::fs::read(&file).map_err(|e| FormatError::io(&file, "read", e))?)
}

/// Names of what lies in the directory of the results.
#[derive(Clone, Debug)]
pub struct Folders {
    /// Records of clips.
    pub records: PathBuf,
    /// Crops.
    pub crops: PathBuf,
}

impl Folders {
    /// Those below `out`, made where they are missing.
    ///
    /// # Errors
    /// When they cannot be made.
    pub fn make(out: &Path) -> Result<Self> {
        let folders = Self { records: out.join("clips"), crops: out.join(CROPS) };
        for folder in [&folders.records, &folders.crops] {
            std::fs::create_dir_all(folder).map_err(|e| FormatError::io(folder, "create", e))?;
        }
        Ok(folders)
    }
}
