//! The whole work: every size, what is missing of it, and the pages that show it.

use std::path::{Path, PathBuf};

use lgs_formats::{error::FormatError, write::write_atomic};
use serde::Serialize;

use super::{
    csv,
    measure::{Space, Times},
    page::{Page, html},
    plan::{Plan, Size},
    record::{FailedSize, ScalingKey, SizeRecord},
    street,
    table::{PartRow, rows},
};
use crate::{error::Result, records::json, sweep::job::Observer};

/// The value of `format` in `scaling.json`.
pub const FORMAT: &str = "lgs-scaling/1";
/// Folder of the records.
const RECORDS: &str = "sizes";
/// Folder of the clip that is being measured, removed when it is.
const CLIP: &str = "clip-of-a-size";

/// Measures clips, in processes of their own.
pub trait Meter: std::fmt::Debug {
    /// What runs of the clip in `dir` take.
    ///
    /// # Errors
    /// When it cannot be measured.
    fn times(&self, dir: &Path) -> Result<Times>;
    /// What a run of the clip in `dir` needs, and what there is to do.
    ///
    /// # Errors
    /// When it cannot be measured.
    fn space(&self, dir: &Path) -> Result<Space>;
}

/// What is to be measured.
#[derive(Debug)]
pub struct ScalingJob<'a> {
    /// The sizes.
    pub plan: Plan,
    /// What decides the figures beside the sizes.
    pub key: ScalingKey,
    /// Directory of the results.
    pub out: PathBuf,
    /// Measures.
    pub meter: &'a dyn Meter,
}

/// What a job found.
#[derive(Debug, Default)]
pub struct ScalingFindings {
    /// Each part along each axis.
    pub rows: Vec<PartRow>,
    /// What could not be measured.
    pub failed: Vec<FailedSize>,
}

/// `scaling.json`.
#[derive(Serialize)]
struct Whole<'a> {
    format: &'static str,
    key: &'a ScalingKey,
    rows: &'a [PartRow],
    sizes: &'a [SizeRecord],
    failed: &'a [FailedSize],
}

impl ScalingJob<'_> {
    /// The weight of everything.
    pub fn total_weight(&self) -> u64 {
        self.plan.sizes().iter().map(Size::weight).sum()
    }

    /// What was found, after everything that was missing was measured and the pages were written.
    ///
    /// # Errors
    /// When the directory cannot be written to.
    pub fn run(&self, observer: &dyn Observer) -> Result<ScalingFindings> {
        let folder = self.out.join(RECORDS);
        std::fs::create_dir_all(&folder).map_err(|e| FormatError::io(&folder, "create", e))?;
        let (mut records, mut failed) = (Vec::new(), Vec::new());
        for size in self.plan.sizes() {
            observer.begin(&size.to_string());
            let file = SizeRecord::file(&folder, &size);
            if let Some(record) = SizeRecord::read(&file, &self.key)? {
                records.push(record);
                observer.did(size.weight(), false);
                continue;
            }
            match self.measure(&size) {
                Ok(record) => {
                    record.write(&file)?;
                    records.push(record);
                }
                Err(error) => {
                    let reason = error.to_string();
                    observer.note(&format!("{size}: {reason}"));
                    failed.push(FailedSize { size: size.to_string(), reason });
                }
            }
            observer.did(size.weight(), true);
        }
        let found = ScalingFindings { rows: rows(&self.plan, &records), failed };
        self.write(&records, &found)?;
        Ok(found)
    }

    fn measure(&self, size: &Size) -> Result<SizeRecord> {
        let dir = self.out.join(CLIP);
        // Left there by a run that was interrupted.
        remove(&dir)?;
        street::make(size, &dir)?;
        let measured = self.meter.space(&dir).and_then(|space| Ok((space, self.meter.times(&dir)?)));
        remove(&dir)?;
        let (space, times) = measured?;
        Ok(SizeRecord { key: self.key.clone(), size: *size, times, space })
    }

    fn write(&self, records: &[SizeRecord], found: &ScalingFindings) -> Result<()> {
        let ScalingFindings { rows, failed } = found;
        let whole = Whole { format: FORMAT, key: &self.key, rows, sizes: records, failed };
        let json = json("scaling.json", &whole)?;
        let page = html(&Page { machine: &self.key.machine, rows, records, failed });
        for (name, text) in [
            ("scaling.json", json),
            ("scaling.csv", csv::costs(rows)),
            ("exponents.csv", csv::exponents(rows)),
            ("sizes.csv", csv::sizes(records)),
            ("scaling.html", page),
        ] {
            write_atomic(&self.out.join(name), text.as_bytes())?;
        }
        Ok(())
    }
}

/// Removes a directory, where there is one.
fn remove(dir: &Path) -> Result<()> {
    match std::fs::remove_dir_all(dir) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(FormatError::io(dir, "remove", error).into()),
        _ => Ok(()),
    }
}
