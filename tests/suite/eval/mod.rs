//! `lgs-eval` as a process: its figures, jobs that are interrupted or divided, failures, its pages.

mod deploy;
mod interruptions;
mod job;
mod pages;

use std::{
    fs,
    path::{Path, PathBuf},
};

use lgs_tests::{
    Outcome,
    process::{Finished, binary, run},
};
use libtest_mimic::Trial;
use serde_json::Value;

/// Small enough that a snippet takes a fraction of a second.
const SMALL: [&str; 10] =
    ["--protocol", "own", "--snippet-frames", "3", "--stride", "1", "--image-size", "24x40", "--weights", "none"];

pub(crate) fn cases() -> Vec<Trial> {
    [job::cases(), deploy::cases(), interruptions::cases(), pages::cases()].into_iter().flatten().collect()
}

/// Runs `lgs-eval` in a folder.
fn eval(folder: &Path, arguments: &[&str]) -> Result<Finished, String> {
    run(&binary("lgs-eval")?, arguments, folder)
}

/// `evaluation.json` of a folder.
fn evaluation(out: &Path) -> Result<Value, String> {
    let path = out.join("evaluation.json");
    let text = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    serde_json::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))
}

/// Every file below a folder that is the same in every run, with its bytes: all but times and the page that shows them.
fn product(folder: &Path) -> Result<Vec<(PathBuf, Vec<u8>)>, String> {
    let failed = |path: &Path, e: std::io::Error| format!("{}: {e}", path.display());
    let (mut all, mut open) = (Vec::new(), vec![folder.to_owned()]);
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(&next).map_err(|e| failed(&next, e))? {
            let path = entry.map_err(|e| failed(&next, e))?.path();
            let name = path.strip_prefix(folder).map_err(|e| e.to_string())?.to_owned();
            let is_of_times = ["times", "times.csv", "report.html"].iter().any(|other| name == Path::new(other));
            if is_of_times {
                continue;
            }
            if path.is_dir() {
                open.push(path);
            } else {
                let bytes = fs::read(&path).map_err(|e| failed(&path, e))?;
                all.push((name, bytes));
            }
        }
    }
    all.sort();
    Ok(all)
}

/// Fails unless both folders hold the same files.
fn same_product(got: &Path, want: &Path) -> Outcome {
    let (files, wanted) = (product(got)?, product(want)?);
    let names = |files: &[(PathBuf, Vec<u8>)]| files.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
    if names(&files) != names(&wanted) {
        return Err(format!("files {:?}, want {:?}", names(&files), names(&wanted)).into());
    }
    match files.iter().zip(&wanted).find(|(got, want)| got.1 != want.1) {
        None => Ok(()),
        Some(((name, _), _)) => Err(format!("{}: other bytes", name.display()).into()),
    }
}
