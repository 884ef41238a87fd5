//! The job: drives in, figures of all their snippets out, whatever happens in between.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use lgs_engine::recipe::KNOBS;
use lgs_formats::jobs::{FailedItem, ItemEvent, Items, Part, RecordJob, RecordManifest, Tried};
use serde_json::Value;

use super::{
    drives::Drive,
    findings::{Findings, Found, KEY_FORMAT, Key, RecordedRecipe},
    opened::{OpenDrive, num_frames},
    protocol::{Protocol, Snippet},
    record::SnippetRecord,
    snippet::{Evaluator, NamedRecipe},
    times,
};
use crate::error::{MeasureError, Result};

/// An evaluation.
#[derive(Debug)]
pub struct EvaluationJob<'a> {
    /// The drives.
    pub drives: &'a [Drive],
    /// How each snippet is evaluated.
    pub evaluator: Evaluator<'a>,
    /// SHA-256 of the weights; `None` without a network.
    pub weights: Option<String>,
    /// SHA-256 of the weights of LPIPS; `None` without them.
    pub lpips_weights: Option<String>,
    /// Which part is done; `None` for all.
    pub part: Option<Part>,
    /// Whether snippets may be done already.
    pub resume: bool,
    /// Folder to write to.
    pub out: &'a Path,
}

/// A drive and its snippets, or why it has none.
struct Cut<'a> {
    drive: &'a Drive,
    snippets: std::result::Result<Vec<Snippet>, MeasureError>,
}

impl EvaluationJob<'_> {
    /// Evaluates every snippet that is not done yet. One that fails is listed and skipped, as is a drive that has none.
    ///
    /// # Errors
    /// No drive that has snippets; a folder that holds another job, or one that is not to be resumed, or cannot be written to.
    pub fn run(&self, tell: &mut dyn FnMut(ItemEvent<'_>)) -> Result<(Findings, Tried)> {
        let cuts: Vec<Cut<'_>> = self.drives.iter().map(|drive| cut(self.evaluator.protocol, drive)).collect();
        let (key, cuts) = (self.key(), at_least_one(cuts)?);
        let of_snippets: BTreeSet<String> = cuts
            .iter()
            .flat_map(|cut| cut.snippets.iter().flatten().map(|snippet| item_name(cut.drive, snippet)))
            .collect();
        let mut names: Vec<String> = Vec::new();
        let mut known: BTreeMap<String, (&Cut<'_>, Option<&Snippet>)> = BTreeMap::new();
        for cut in &cuts {
            let snippets = cut.snippets.iter().flatten().map(|snippet| (item_name(cut.drive, snippet), Some(snippet)));
            let unread = cut.snippets.is_err().then(|| (unread_name(cut.drive, &of_snippets), None));
            for (name, snippet) in snippets.chain(unread) {
                names.push(name.clone());
                known.insert(name, (cut, snippet));
            }
        }
        let value = to_value(&key)?;
        let items = Items { all: &names, part: self.part, resume: self.resume };
        let job = RecordJob { out: self.out, key: &value, items };
        let mut open = OpenDrive::default();
        let mut make = |item: &str| {
            let Some((cut, snippet)) = known.get(item) else {
                return Err(MeasureError::unfit("DRIVES", "the drive of a snippet", item));
            };
            match (&cut.snippets, snippet) {
                (Ok(all), Some(snippet)) => {
                    let dir = open.get(cut.drive, all, snippet, self.evaluator.protocol.cameras.as_deref())?;
                    let (made, took) = self.evaluator.evaluate(&cut.drive.name, dir, snippet)?;
                    times::keep(self.out, item, &took)?;
                    Ok(made)
                }
                (Err(why), _) => Err(MeasureError::Point(why.to_string())),
                (Ok(_), None) => Err(MeasureError::unfit("DRIVES", "a snippet of a drive", item)),
            }
        };
        let (manifest, tried) = job.run(&mut make, tell)?;
        if self.resume && self.part.is_none() {
            times::remove_unfinished(self.out)?;
        }
        Ok((findings(self.out, key, &manifest, &items)?, tried))
    }

    fn key(&self) -> Key {
        let Evaluator { protocol, recipes, seed, scenes, viewer, .. } = &self.evaluator;
        Key {
            format: KEY_FORMAT.to_owned(),
            protocol: protocol.recorded(),
            recipes: recipes.iter().map(recorded).collect(),
            weights: self.weights.clone(),
            lpips_weights: self.lpips_weights.clone(),
            seed: *seed,
            scenes: *scenes,
            viewer: *viewer,
        }
    }
}

/// The whole of the parts in `folders`.
///
/// # Errors
/// Parts that do not make a whole, are of another kind of job, or cannot be read or written.
pub fn merge(folders: &[PathBuf], out: &Path) -> Result<Findings> {
    let manifest = RecordManifest::merge(folders, out)?;
    times::merge(folders, out, &manifest.items)?;
    let key: Key = serde_json::from_value(manifest.key.clone())
        .map_err(|source| MeasureError::Json { what: "key of the parts", source })?;
    let items = Items { all: &manifest.items, part: None, resume: true };
    findings(out, key, &manifest, &items)
}

fn cut<'a>(protocol: &Protocol, drive: &'a Drive) -> Cut<'a> {
    let frames = num_frames(drive, protocol.cameras.as_deref());
    Cut { drive, snippets: frames.map_err(MeasureError::from).and_then(|frames| protocol.snippets(frames)) }
}

/// The drives, once it is known that one of them has snippets.
fn at_least_one(mut cuts: Vec<Cut<'_>>) -> Result<Vec<Cut<'_>>> {
    if cuts.iter().any(|cut| cut.snippets.is_ok()) || cuts.is_empty() {
        return Ok(cuts);
    }
    let first = cuts.swap_remove(0);
    match first.snippets {
        Err(error @ MeasureError::Setting { .. }) => Err(MeasureError::Point(format!("{}: {error}", first.drive.name))),
        Err(error) => Err(error),
        Ok(_) => Ok(cuts),
    }
}

fn item_name(drive: &Drive, snippet: &Snippet) -> String {
    format!("{}-{:05}", drive.name, snippet.first())
}

/// The item of a drive that has no snippets: its name, or one that no snippet of another drive has.
fn unread_name(drive: &Drive, of_snippets: &BTreeSet<String>) -> String {
    let name = drive.name.clone();
    // No name of a drive ends so.
    if of_snippets.contains(&name) { name + "~" } else { name }
}

fn recorded(named: &NamedRecipe) -> RecordedRecipe {
    let option = |knob: &lgs_engine::recipe::Knob| Some((knob.key(), (knob.get)(&named.recipe)?));
    RecordedRecipe { name: named.name.clone(), options: KNOBS.iter().filter_map(option).collect() }
}

fn to_value(key: &Key) -> Result<Value> {
    serde_json::to_value(key).map_err(|source| MeasureError::Json { what: "key", source })
}

/// What the folder holds of the items of a manifest.
fn findings(out: &Path, key: Key, manifest: &RecordManifest, items: &Items<'_>) -> Result<Findings> {
    let job = RecordJob { out, key: &manifest.key, items: *items };
    let mut snippets = Vec::with_capacity(manifest.done.len());
    for done in &manifest.done {
        let Some(record) = job.record(&done.item)? else { continue };
        let record: SnippetRecord =
            serde_json::from_value(record).map_err(|source| MeasureError::Json { what: "snippet", source })?;
        snippets.push(Found { item: done.item.clone(), record, times: times::read(out, &done.item)? });
    }
    let failed: Vec<FailedItem> = manifest.failed.clone();
    Ok(Findings { key, snippets, failed })
}
