//! The front over many clips: each is measured once and kept; the tables are written anew after every one.

use std::path::{Path, PathBuf};

use lgs_engine::network::model::Model;
use lgs_formats::{error::FormatError, write::write_atomic};
use serde::Serialize;

use super::{
    compare::{SignalComparison, comparisons},
    markdown::markdown,
    measure::measure,
    picture::picture,
    record::{CLIP_FORMAT, DensityKey, DensityPoint, DensityRecord, DensitySettings},
};
use crate::{
    ablate::{job::Hashed, subject::Subject},
    clips::{Choice, open},
    error::Result,
    records::{file_stem, json, write_record},
};

/// The value of `format` in `density.json`.
pub const FORMAT: &str = "lgs-density/1";
/// Folder of the records of clips.
const RECORDS: &str = "clips";

/// What is to be measured.
#[derive(Debug)]
pub struct DensityJob<'a> {
    /// The clips.
    pub clips: Vec<Choice>,
    /// The network.
    pub model: Hashed<'a, Model>,
    /// What is measured on a clip.
    pub settings: DensitySettings,
    /// Directory of the results.
    pub out: PathBuf,
}

/// `density.json`.
#[derive(Serialize)]
struct Page<'a> {
    format: &'static str,
    weights: &'a str,
    settings: &'a DensitySettings,
    comparisons: Vec<SignalComparison>,
    clips: &'a [DensityRecord],
}

impl DensityJob<'_> {
    /// Points of a clip.
    pub const fn points_per_clip(&self) -> usize {
        1 + self.settings.signals.len() * self.settings.percents.len()
    }

    /// The page of tables; it and everything else lies in the directory of the results. `told` hears of every point and of the clip's name;
    /// a clip whose record is there tells all its points at once.
    ///
    /// # Errors
    /// Whatever is wrong with a clip; a file that cannot be written.
    pub fn run(&self, told: &mut dyn FnMut(&str, &DensityPoint)) -> Result<String> {
        self.settings.validate()?;
        let records = self.out.join(RECORDS);
        std::fs::create_dir_all(&records).map_err(|e| FormatError::io(&records, "create", e))?;
        let (mut found, mut page) = (Vec::new(), String::new());
        for (index, choice) in self.clips.iter().enumerate() {
            found.push(self.record(choice, index, &records, told)?);
            page = self.write(&found)?;
        }
        Ok(page)
    }

    fn record(
        &self,
        choice: &Choice,
        index: usize,
        records: &Path,
        told: &mut dyn FnMut(&str, &DensityPoint),
    ) -> Result<DensityRecord> {
        let dir = open(choice)?;
        let name = dir.clip().name.clone();
        let key = DensityKey {
            format: CLIP_FORMAT.to_owned(),
            weights: self.model.sha256.to_owned(),
            source: dir.clip().source.clone(),
            choice: choice.recorded(),
            settings: self.settings.clone(),
        };
        let file = records.join(file_stem(index, &name) + ".json");
        if let Some(record) = DensityRecord::read(&file, &key)? {
            record.points.iter().for_each(|point| told(&name, point));
            return Ok(record);
        }
        let subject = Subject::load(dir, choice, None)?;
        let record = measure(&subject, self.model.value, key, &mut |point| told(&name, point))?;
        write_record(&file, &record)?;
        Ok(record)
    }

    /// The page of tables, written with everything else that the records say together.
    fn write(&self, records: &[DensityRecord]) -> Result<String> {
        let put = |name: &str, text: &str| write_atomic(&self.out.join(name), text.as_bytes());
        let page = markdown(records);
        put("density.md", &page)?;
        let whole = Page {
            format: FORMAT,
            weights: self.model.sha256,
            settings: &self.settings,
            comparisons: comparisons(records),
            clips: records,
        };
        put("density.json", &json("density.json", &whole)?)?;
        let svg = picture("mean over the clips", records);
        if !svg.is_empty() {
            put("density.svg", &svg)?;
        }
        Ok(page)
    }
}
