//! This program in a process of its own, whose memory is that of its work alone.

use std::{
    ffi::OsStr,
    path::Path,
    process::{Command, Stdio},
};

use lgs_measure::error::{MeasureError, Result};
use serde::de::DeserializeOwned;

/// What `program` answers to the flags of this process and some more.
///
/// # Errors
/// When it fails, with the last line that it said.
pub(crate) fn ask<T: DeserializeOwned>(program: &Path, more: &[&OsStr]) -> Result<T> {
    answer(Command::new(program).args(std::env::args_os().skip(1)).args(more))
}

/// What a command prints as JSON.
///
/// # Errors
/// When it fails, with the last line that it said.
pub(crate) fn answer<T: DeserializeOwned>(command: &mut Command) -> Result<T> {
    let output = command.stdin(Stdio::null()).output();
    let output = output.map_err(|e| MeasureError::Point(format!("a process of its own could not be started: {e}")))?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let last = said.lines().last().map_or("", |line| line.split_once(": ").map_or(line, |(_, said)| said));
        let reason = if last.is_empty() { output.status.to_string() } else { last.to_owned() };
        return Err(MeasureError::Point(reason));
    }
    serde_json::from_slice(&output.stdout).map_err(|source| MeasureError::Json { what: "answer of a process", source })
}
