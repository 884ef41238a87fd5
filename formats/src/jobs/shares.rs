//! How a job's folder is divided: written by its first share, so that a share that is submitted again alone is still the same one.

use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::Part;
use crate::{
    error::{FormatError, Result},
    write::write_atomic,
};

/// Name of the file that says how a job is divided.
pub const SHARES_FILE: &str = "shares.json";

/// The tasks of a job that is divided: `first`, `first + step`, ..., `count` of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shares {
    /// Number of the first task.
    pub first: usize,
    /// Between the numbers of two tasks.
    pub step: usize,
    /// How many shares there are.
    pub count: usize,
}

/// A task of a job as its setting or its scheduler calls it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Task {
    /// What errors name.
    pub(super) name: &'static str,
    /// Its number.
    pub(super) number: usize,
    /// How the job is divided, as far as this task is told.
    pub(super) shares: Shares,
    /// Whether all tasks of the job are always told the same: a scheduler that starts some of them again may tell these alone.
    pub(super) is_whole: bool,
}

impl Shares {
    /// How the job in a folder is divided; `None` before its first share.
    ///
    /// # Errors
    /// A file that cannot be read or says something else.
    pub fn read(folder: &Path) -> Result<Option<Self>> {
        let file = folder.join(SHARES_FILE);
        let text = match fs::read(&file) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(FormatError::io(&file, "read", e)),
        };
        let shares: Self =
            serde_json::from_slice(&text).map_err(|e| FormatError::syntax(&file, "shares", e.to_string()))?;
        if shares.step == 0 || shares.count == 0 {
            return Err(FormatError::invalid(&file, "step, count", "1 or more", format!("{shares:?}")));
        }
        Ok(Some(shares))
    }

    /// Writes down how the job in a folder, which is made where it is missing, is divided.
    ///
    /// # Errors
    /// A folder that cannot be written to.
    pub fn write(&self, folder: &Path) -> Result<()> {
        fs::create_dir_all(folder).map_err(|e| FormatError::io(folder, "create", e))?;
        let text = serde_json::json!(self).to_string() + "\n";
        write_atomic(&folder.join(SHARES_FILE), text.as_bytes())
    }

    /// The share of a task of this number.
    fn part(&self, number: usize) -> Option<Part> {
        let above = number.checked_sub(self.first)?;
        let index = above / self.step + 1;
        (above.is_multiple_of(self.step) && index <= self.count).then_some(Part { index, count: self.count })
    }

    fn in_words(&self) -> String {
        let Self { first, step, count } = self;
        format!("{count} shares, tasks {first} to {}", first.saturating_add(step.saturating_mul(count - 1)))
    }
}

impl Task {
    /// The share of the task in a folder whose job is divided as `known` says, and how it is divided.
    ///
    /// # Errors
    /// A task that is none of the job's.
    pub(super) fn part(&self, folder: &Path, known: Option<Shares>) -> Result<(Part, Shares)> {
        let shares = known.unwrap_or(self.shares);
        let same = !self.is_whole || shares == self.shares;
        if let Some(part) = shares.part(self.number).filter(|_| same) {
            return Ok((part, shares));
        }
        if known.is_some() {
            let file = folder.join(SHARES_FILE);
            let expected =
                format!("{} as {} says; another job goes into another folder", shares.in_words(), file.display());
            let found = format!("task {} of {}", self.number, self.shares.in_words());
            return Err(FormatError::unfit(folder, self.name, expected, found));
        }
        let found = format!(
            "task {} of {}; give `part I/N` where tasks are not numbered evenly",
            self.number, self.shares.count
        );
        Err(FormatError::unfit(folder, self.name, "tasks that are numbered evenly", found))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_back_and_nothing_else_is_read() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("new");
        assert_eq!(Shares::read(&folder).unwrap(), None);
        let shares = Shares { first: 1, step: 2, count: 3 };
        shares.write(&folder).unwrap();
        assert_eq!(Shares::read(&folder).unwrap(), Some(shares));
        for text in ["", "{}", "{\"first\": 1, \"step\": 0, \"count\": 3}", "{\"first\": 1, \"step\": 1, \"count\": 0}"]
        {
            fs::write(folder.join(SHARES_FILE), text).unwrap();
            let message = Shares::read(&folder).unwrap_err().to_string();
            assert!(message.contains(SHARES_FILE), "{message}");
        }
    }
}
