//! An ablation over many clips: each is measured once and kept; the tables are written anew after every one.

use std::{
    path::{Path, PathBuf},
    slice,
};

use lgs_engine::{evaluate::lpips::Lpips, network::model::Model};
use lgs_formats::{error::FormatError, write::write_atomic};
use serde::Serialize;

use super::{
    compare::{Comparison, comparisons},
    csv::figures,
    markdown::{AblationRecords, markdown},
    picture::picture,
    record::{AblationKey, AblationRecord, CLIP_FORMAT},
    scene::{measure, num_told},
    settings::Settings,
    subject::Subject,
};
use crate::{
    clips::{Choice, open},
    error::Result,
    records::json,
};

/// The value of `format` in `ablation.json`.
pub const FORMAT: &str = "lgs-ablation/1";
/// Folder of the records of clips.
const RECORDS: &str = "clips";

/// Something of a file, and the SHA-256 of the file.
#[derive(Clone, Copy, Debug)]
pub struct Hashed<'a, T> {
    /// The thing.
    pub value: &'a T,
    /// SHA-256 of its file, hexadecimal.
    pub sha256: &'a str,
}

/// What is to be measured.
#[derive(Debug)]
pub struct AblationJob<'a> {
    /// Scenes that means and tests are taken over.
    pub scenes: Vec<Choice>,
    /// Clips that stand for themselves; they are measured first.
    pub clips: Vec<Choice>,
    /// The network.
    pub model: Hashed<'a, Model>,
    /// The perceptual distance.
    pub lpips: Option<Hashed<'a, Lpips>>,
    /// What is measured on a clip.
    pub settings: Settings,
    /// Scenes after this many get no more than so many passes of per-scene optimisation.
    pub short: Option<Short>,
    /// Directory of the results.
    pub out: PathBuf,
}

/// A limit to what per-scene optimisation costs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Short {
    /// Scenes without the limit.
    pub after: usize,
    /// Most steps of the others.
    pub most: usize,
}

/// Somebody who is told how far the work is.
pub trait Observer {
    /// A clip is begun, or its record is there already.
    fn begin(&self, clip: &Path, there: bool);
    /// So many steps of some kind were done.
    fn step(&self, steps: u64);
    /// A clip is done; these are steps that it turned out not to need.
    fn end(&self, record: &AblationRecord, left_out: u64);
}

/// `ablation.json`.
#[derive(Serialize)]
struct Page<'a> {
    format: &'static str,
    weights: &'a str,
    settings: &'a Settings,
    comparisons: Vec<Comparison>,
    scenes: &'a [AblationRecord],
    clips: &'a [AblationRecord],
}

impl AblationJob<'_> {
    /// The settings of every clip, clips that stand for themselves first.
    fn all(&self) -> Vec<(&Choice, Settings)> {
        let clips = self.clips.iter().map(|choice| (choice, self.settings.clone()));
        let scenes = self.scenes.iter().enumerate().map(|(k, choice)| {
            let limit = self.short.filter(|short| k >= short.after);
            (choice, limit.map_or_else(|| self.settings.clone(), |short| self.settings.with_at_most(short.most)))
        });
        clips.chain(scenes).collect()
    }

    /// Steps that progress is told of.
    pub fn num_steps(&self) -> u64 {
        self.all().iter().map(|(_, settings)| num_told(settings)).sum()
    }

    /// The page of tables; it and everything else lies in the directory of the results.
    ///
    /// # Errors
    /// Whatever is wrong with a clip; a file that cannot be written.
    pub fn run(&self, observer: &dyn Observer) -> Result<String> {
        self.settings.validate()?;
        let records = self.out.join(RECORDS);
        std::fs::create_dir_all(&records).map_err(|e| FormatError::io(&records, "create", e))?;
        let (mut clips, mut scenes, mut page) = (Vec::new(), Vec::new(), String::new());
        for (index, (choice, settings)) in self.all().into_iter().enumerate() {
            let record = self.record(choice, settings, &records, index, observer)?;
            if index < self.clips.len() {
                clips.push(record)
            } else {
                scenes.push(record)
            }
            page = self.write(&scenes, &clips)?;
        }
        Ok(page)
    }

    fn record(
        &self,
        choice: &Choice,
        settings: Settings,
        records: &Path,
        index: usize,
        observer: &dyn Observer,
    ) -> Result<AblationRecord> {
        let dir = open(choice)?;
        let key = AblationKey {
            format: CLIP_FORMAT.to_owned(),
            weights: self.model.sha256.to_owned(),
            lpips: self.lpips.as_ref().map(|lpips| lpips.sha256.to_owned()),
            source: dir.clip().source.clone(),
            choice: choice.recorded(),
            settings,
        };
        let (file, asked) = (AblationRecord::file(records, index, &dir.clip().name), num_told(&key.settings));
        if let Some(record) = AblationRecord::read(&file, &key)? {
            observer.begin(&choice.dir, true);
            observer.end(&record, asked);
            return Ok(record);
        }
        observer.begin(&choice.dir, false);
        let subject = Subject::load(dir, choice, self.lpips.as_ref().map(|lpips| lpips.value))?;
        let mut told = 0;
        let record = measure(&subject, self.model.value, key, &mut |steps| {
            told += steps;
            observer.step(steps);
        })?;
        record.write(&file)?;
        observer.end(&record, asked.saturating_sub(told));
        Ok(record)
    }

    /// The page of tables, written with everything else that the records say together.
    fn write(&self, scenes: &[AblationRecord], clips: &[AblationRecord]) -> Result<String> {
        let put = |name: &str, text: &str| write_atomic(&self.out.join(name), text.as_bytes());
        let page = markdown(AblationRecords { scenes, clips });
        put("ablation.md", &page)?;
        put("ablation.csv", &figures(&clips.iter().chain(scenes).collect::<Vec<_>>()))?;
        let whole = Page {
            format: FORMAT,
            weights: self.model.sha256,
            settings: &self.settings,
            comparisons: comparisons(scenes),
            scenes,
            clips,
        };
        put("ablation.json", &json("ablation.json", &whole)?)?;
        let means = [("curve.svg".to_owned(), picture("mean over the scenes", scenes))];
        let of_clips = clips.iter().enumerate();
        let of_clips = of_clips.map(|(k, clip)| (format!("curve_{k}.svg"), picture(&clip.clip, slice::from_ref(clip))));
        for (name, svg) in means.into_iter().chain(of_clips).filter(|(_, svg)| !svg.is_empty()) {
            put(&name, &svg)?;
        }
        Ok(page)
    }
}
