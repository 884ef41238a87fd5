//! Jobs whose items each give a JSON record, and files where they want some.
//!
//! `items/<item>.json` holds a record, `items/<item>/` its files, which are written before it. `manifest.json` says what there is; that of
//! a part is `part-I-of-N.json`.

use std::{
    fmt::Display,
    fs,
    path::{Component, Path, PathBuf},
};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{
    FailedItem, ItemEvent, ItemStore, Items, Part, PartManifest, Tried, check_parts, is_merged, merge::same_folder,
    part_file, read_parts, remove_parts, remove_unfinished, try_items,
};
use crate::{
    digest::sha256,
    error::{FormatError, Result},
    read::{MAX_DATA_BYTES, read_file},
    targets::{MANIFEST_FILE, is_clip_name},
    write::write_atomic,
};

/// Name of the format of manifests.
pub const RECORDS_FORMAT: &str = "lgs-records/1";
/// Folder of what is kept of the items.
const ITEMS: &str = "items";

/// What is made of an item.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Made {
    /// The record.
    pub record: Value,
    /// Names and bytes of files.
    pub files: Vec<(String, Vec<u8>)>,
}

/// A job in a folder, or one part of it.
#[derive(Clone, Copy, Debug)]
pub struct RecordJob<'a> {
    /// Folder to write to, made where it is missing.
    pub out: &'a Path,
    /// What decides the results beside the items: what is kept under another key is of another job.
    pub key: &'a Value,
    /// The items.
    pub items: Items<'a>,
}

/// What a folder of records holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordManifest {
    /// [`RECORDS_FORMAT`].
    pub format: String,
    /// Which part of the job this is; `None` for all of it.
    pub part: Option<Part>,
    /// What decides the results beside the items.
    pub key: Value,
    /// Every item of the job, in its order.
    pub items: Vec<String>,
    /// The items that are done, in their order.
    pub done: Vec<DoneItem>,
    /// The items that failed, in their order.
    pub failed: Vec<FailedItem>,
}

/// An item that is done.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DoneItem {
    /// Its name.
    pub item: String,
    /// SHA-256 of the file of its record.
    pub sha256: String,
}

/// The file of a record.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RecordFile {
    key: Value,
    record: Value,
    /// Names and SHA-256 of its files.
    files: Vec<(String, String)>,
}

/// A folder of records.
struct Folder<'a> {
    root: &'a Path,
    key: &'a Value,
}

fn json(path: &Path, value: &impl Serialize) -> Result<Vec<u8>> {
    let text = serde_json::to_string_pretty(value);
    let text = text.map_err(|e| FormatError::invalid(path, "content", "values that JSON can hold", e.to_string()))?;
    Ok((text + "\n").into_bytes())
}

fn parse<T: for<'de> Deserialize<'de>>(path: &Path, bytes: &[u8]) -> Result<T> {
    let mut json = serde_json::Deserializer::from_slice(bytes);
    serde_path_to_error::deserialize(&mut json)
        .map_err(|e| FormatError::syntax(path, e.path().to_string(), e.inner().to_string()))
}

impl Folder<'_> {
    fn record_path(&self, item: &str) -> PathBuf {
        self.root.join(ITEMS).join(format!("{item}.json"))
    }

    fn file_path(&self, item: &str, name: &str) -> PathBuf {
        self.root.join(ITEMS).join(item).join(name)
    }

    /// The file of an item's record, with its bytes, where it is there and its files are as it says; `None` without one.
    fn read(&self, item: &str) -> Result<Option<(RecordFile, Vec<u8>)>> {
        let path = self.record_path(item);
        if !path.exists() {
            return Ok(None);
        }
        let bytes = read_file(&path, MAX_DATA_BYTES)?;
        let file: RecordFile = parse(&path, &bytes)?;
        if file.key != *self.key {
            return Err(FormatError::invalid(&path, "key", self.key.to_string(), file.key.to_string()));
        }
        for (name, wanted) in &file.files {
            check_name(&path, name)?;
            let path = self.file_path(item, name);
            let found = sha256(&read_file(&path, MAX_DATA_BYTES)?);
            if found != *wanted {
                return Err(FormatError::invalid(&path, "SHA-256", wanted, found));
            }
        }
        Ok(Some((file, bytes)))
    }

    /// Writes the manifest of what was tried.
    fn finish(&self, items: &Items<'_>, failed: Vec<FailedItem>) -> Result<RecordManifest> {
        let mut done = Vec::new();
        for item in items.own().into_iter().filter(|item| failed.iter().all(|failed| failed.item != *item)) {
            let path = self.record_path(item);
            let Some((_, bytes)) = self.read(item)? else {
                return Err(FormatError::invalid(&path, "record", format!("that of {item}"), "no file"));
            };
            done.push(DoneItem { item: item.to_owned(), sha256: sha256(&bytes) });
        }
        let manifest = RecordManifest {
            format: RECORDS_FORMAT.to_owned(),
            part: items.part,
            key: self.key.clone(),
            items: items.all.to_vec(),
            done,
            failed,
        };
        let path = self.root.join(items.part.map_or(MANIFEST_FILE.to_owned(), part_file));
        write_atomic(&path, &json(&path, &manifest)?)?;
        Ok(manifest)
    }
}

/// Fails for a name that leads out of the item's folder, or is no name.
fn check_name(path: &Path, name: &str) -> Result<()> {
    let mut parts = Path::new(name).components();
    match (parts.next(), parts.next()) {
        (Some(Component::Normal(_)), None) => Ok(()),
        _ => Err(FormatError::invalid(path, "files", "names without folders", name)),
    }
}

impl ItemStore for Folder<'_> {
    type Made = Made;
    type Error = FormatError;

    fn has(&self, item: &str) -> Result<bool> {
        Ok(self.read(item)?.is_some())
    }

    fn keep(&mut self, item: &str, made: Made) -> Result<()> {
        let path = self.record_path(item);
        if !made.files.is_empty() {
            let folder = self.root.join(ITEMS).join(item);
            fs::create_dir_all(&folder).map_err(|e| FormatError::io(&folder, "create", e))?;
            remove_unfinished(&folder)?;
        }
        let mut files = Vec::with_capacity(made.files.len());
        for (name, bytes) in made.files {
            check_name(&path, &name)?;
            write_atomic(&self.file_path(item, &name), &bytes)?;
            files.push((name, sha256(&bytes)));
        }
        let file = RecordFile { key: self.key.clone(), record: made.record, files };
        write_atomic(&path, &json(&path, &file)?)
    }
}

impl RecordJob<'_> {
    /// Does every item that is not done yet, and writes the manifest of the job or of its part.
    ///
    /// # Errors
    /// Names that cannot be those of files, a folder that holds results and is not to be resumed, and one that cannot be written to.
    pub fn run<E: Display>(
        &self,
        make: &mut dyn FnMut(&str) -> std::result::Result<Made, E>,
        tell: &mut dyn FnMut(ItemEvent<'_>),
    ) -> Result<(RecordManifest, Tried)> {
        let Self { out, key, items } = self;
        if let Some((i, name)) =
            items.all.iter().enumerate().find(|(i, name)| !is_clip_name(name) || items.all[..*i].contains(name))
        {
            let expected = "distinct names of 1 to 128 letters, digits and . _ ~ -";
            return Err(FormatError::invalid(out, format!("item {i}"), expected, format!("{name:?}")));
        }
        let folder = out.join(ITEMS);
        fs::create_dir_all(&folder).map_err(|e| FormatError::io(&folder, "create", e))?;
        let mut store = Folder { root: out, key };
        if !items.resume {
            let kept = items.own().into_iter().map(|item| store.record_path(item)).find(|path| path.exists());
            if let Some(path) = kept {
                let expected = "an empty folder, or `resume` to go on";
                return Err(FormatError::unfit(out, "out", expected, path.display().to_string()));
            }
        } else if items.part.is_none() {
            remove_unfinished(out)?;
            remove_unfinished(&folder)?;
        }
        let tried = try_items(&mut store, items, make, tell)?;
        Ok((store.finish(items, tried.failed.clone())?, tried))
    }

    /// The record of an item that is done; `None` where it is not.
    ///
    /// # Errors
    /// A file that cannot be read, or is of another job.
    pub fn record(&self, item: &str) -> Result<Option<Value>> {
        Ok(Folder { root: self.out, key: self.key }.read(item)?.map(|(file, _)| file.record))
    }
}

impl PartManifest for RecordManifest {
    fn read(path: &Path) -> Result<Self> {
        let manifest: Self = parse(path, &read_file(path, MAX_DATA_BYTES)?)?;
        match manifest.items.iter().find(|name| !is_clip_name(name)) {
            _ if manifest.format != RECORDS_FORMAT => {
                Err(FormatError::invalid(path, "format", RECORDS_FORMAT, manifest.format))
            }
            Some(name) => Err(FormatError::invalid(path, "items", "names of items", name.clone())),
            None => Ok(manifest),
        }
    }

    fn part(&self) -> Option<Part> {
        self.part
    }

    fn key(&self) -> String {
        self.key.to_string()
    }

    fn items(&self) -> &[String] {
        &self.items
    }

    fn times_tried(&self, item: &str) -> usize {
        let done = self.done.iter().filter(|done| done.item == item).count();
        done + self.failed.iter().filter(|failed| failed.item == item).count()
    }
}

impl RecordManifest {
    /// Joins the parts in `folders` into one job in `out`. Where an earlier call came to its manifest, only what it left of the parts is
    /// removed.
    ///
    /// # Errors
    /// Parts that do not make a whole; a record that is not as its manifest says; a folder that cannot be written to. The same call goes
    /// on from there.
    pub fn merge(folders: &[PathBuf], out: &Path) -> Result<Self> {
        let parts = read_parts::<Self>(folders)?;
        let whole = out.join(MANIFEST_FILE);
        if whole.exists() {
            let manifest = Self::read(&whole)?;
            if is_merged(&parts, &manifest) {
                remove_parts(&parts, out)?;
                return Ok(manifest);
            }
        }
        check_parts(folders, &parts)?;
        let first = &parts[0].manifest;
        let folder = out.join(ITEMS);
        fs::create_dir_all(&folder).map_err(|e| FormatError::io(&folder, "create", e))?;
        let mut store = Folder { root: out, key: &first.key };
        for part in parts.iter().filter(|part| !same_folder(&part.folder, out)) {
            let from = Folder { root: &part.folder, key: &first.key };
            for DoneItem { item, .. } in &part.manifest.done {
                let Some((file, _)) = from.read(item)? else {
                    let path = from.record_path(item);
                    return Err(FormatError::invalid(&path, "record", format!("that of {item}"), "no file"));
                };
                let bytes = |(name, _): &(String, String)| {
                    Ok((name.clone(), read_file(&from.file_path(item, name), MAX_DATA_BYTES)?))
                };
                let files = file.files.iter().map(bytes).collect::<Result<_>>()?;
                store.keep(item, Made { record: file.record, files })?;
            }
        }
        let failed_of = |name: &String| parts.iter().flat_map(|p| &p.manifest.failed).find(|f| f.item == *name);
        let failed = first.items.iter().filter_map(failed_of).cloned().collect();
        let manifest = store.finish(&Items { all: &first.items, part: None, resume: true }, failed)?;
        remove_parts(&parts, out)?;
        remove_unfinished(out)?;
        remove_unfinished(&folder)?;
        Ok(manifest)
    }
}
