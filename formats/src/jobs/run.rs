//! A run over the items of a job, or of one part of it.

use std::{fmt::Display, fs, path::Path};

use serde::{Deserialize, Serialize};

use super::Part;
use crate::error::{FormatError, Result};

/// The items of a job, and which of them this process does.
#[derive(Clone, Copy, Debug)]
pub struct Items<'a> {
    /// Names of all of them, in their order.
    pub all: &'a [String],
    /// Which part is done; `None` for all.
    pub part: Option<Part>,
    /// Whether items may be done already, by an earlier run of the same job.
    pub resume: bool,
}

/// An item that could not be done.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FailedItem {
    /// Its name.
    pub item: String,
    /// Why.
    pub reason: String,
}

/// What happens while items are done.
#[derive(Clone, Copy, Debug)]
pub enum ItemEvent<'a> {
    /// So many items are to be done; the others of the part are done already.
    Start {
        /// Items to do.
        todo: usize,
        /// Items done in earlier runs.
        done: usize,
    },
    /// An item is done and kept.
    Done(&'a str),
    /// An item failed.
    Failed(&'a FailedItem),
}

/// Where what is made of items is kept, each as soon as it is done.
pub trait ItemStore {
    /// What is made of an item.
    type Made;
    /// What goes wrong with the folder.
    type Error;

    /// Whether an item is done: what is kept of it is whole, and of the same job.
    ///
    /// # Errors
    /// A folder that cannot be read, or something of another job in it.
    fn has(&self, item: &str) -> std::result::Result<bool, Self::Error>;

    /// Keeps what was made of an item.
    ///
    /// # Errors
    /// A folder that cannot be written to.
    fn keep(&mut self, item: &str, made: Self::Made) -> std::result::Result<(), Self::Error>;
}

/// What a run did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tried {
    /// Items done in this run.
    pub done_now: usize,
    /// Items that were done already.
    pub done_before: usize,
    /// Items that failed.
    pub failed: Vec<FailedItem>,
}

impl<'a> Items<'a> {
    /// Those of this part, in their order.
    pub fn own(&self) -> Vec<&'a str> {
        let names = self.all.iter().map(String::as_str);
        match self.part {
            None => names.collect(),
            Some(part) => names.skip(part.index - 1).step_by(part.count).collect(),
        }
    }
}

/// Does every item that is not done yet. One that fails is listed and skipped.
///
/// # Errors
/// What the store says; what was kept stays, and a run that resumes goes on from there.
pub fn try_items<S: ItemStore, E: Display>(
    store: &mut S,
    items: &Items<'_>,
    make: &mut dyn FnMut(&str) -> std::result::Result<S::Made, E>,
    tell: &mut dyn FnMut(ItemEvent<'_>),
) -> std::result::Result<Tried, S::Error> {
    let own = items.own();
    let mut todo = Vec::with_capacity(own.len());
    for &item in &own {
        if !(items.resume && store.has(item)?) {
            todo.push(item);
        }
    }
    let mut tried = Tried { done_before: own.len() - todo.len(), ..Tried::default() };
    tell(ItemEvent::Start { todo: todo.len(), done: tried.done_before });
    for item in todo {
        match make(item) {
            Ok(made) => {
                store.keep(item, made)?;
                tried.done_now += 1;
                tell(ItemEvent::Done(item));
            }
            Err(error) => {
                let failed = FailedItem { item: item.to_owned(), reason: error.to_string() };
                tell(ItemEvent::Failed(&failed));
                tried.failed.push(failed);
            }
        }
    }
    Ok(tried)
}

/// Removes what an interrupted write left in a folder, which may be missing.
///
/// # Errors
/// A folder that cannot be read or written to.
pub fn remove_unfinished(folder: &Path) -> Result<()> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(FormatError::io(folder, "read", error)),
        Ok(entries) => entries,
    };
    for path in entries.flatten().map(|entry| entry.path()) {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        if name.starts_with(".lgs-") && name.ends_with(".part") {
            fs::remove_file(&path).map_err(|e| FormatError::io(&path, "remove", e))?;
        }
    }
    Ok(())
}
