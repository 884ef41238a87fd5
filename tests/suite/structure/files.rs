//! Sizes and contents of the repository's files.

use std::fs;
use std::path::Path;

use lgs_tests::sources::{offence, project_files, rust_files};
use lgs_tests::{Outcome, case, places};
use libtest_mimic::Trial;

/// Longest Rust file, lines.
const MAX_LINES: usize = 500;
/// Largest file of the repository, bytes.
const MAX_BYTES: usize = 4 << 20;
/// Weights that ship, which have a limit of their own.
const WEIGHTS: &str = "models/tiny.safetensors";
/// First directories of absolute paths that exist on somebody's machine only.
const MACHINE_ROOTS: [&str; 6] = ["work", "tmp", "root", "home", "Users", "mnt"];

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("structure::no_rust_file_over_500_lines", no_long_file),
        case("structure::no_machine_paths", no_machine_paths),
        case("structure::no_large_files", no_large_files),
    ]
}

fn report(offences: &[String]) -> Outcome {
    if offences.is_empty() { Ok(()) } else { Err(offences.join("\n").into()) }
}

fn no_long_file() -> Outcome {
    let root = places::repository();
    let files = project_files(root)?;
    let mut offences = Vec::new();
    for path in rust_files(&files) {
        let lines = fs::read_to_string(root.join(path))?.lines().count();
        if lines > MAX_LINES {
            offences.push(offence(path, lines, &format!("{lines} lines, at most {MAX_LINES}")));
        }
    }
    report(&offences)
}

fn no_machine_paths() -> Outcome {
    let root = places::repository();
    let mut offences = Vec::new();
    for path in project_files(root)? {
        offences.extend(machine_paths(&path, &fs::read(root.join(&path))?));
    }
    report(&offences)
}

/// Absolute paths into a machine's directories: `/`, one of the roots, `/`, not in the middle of a longer path.
fn machine_paths(path: &Path, bytes: &[u8]) -> Vec<String> {
    let Ok(text) = std::str::from_utf8(bytes) else { return Vec::new() };
    let mut offences = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        for wanted in MACHINE_ROOTS.map(|name| format!("/{name}/")) {
            let starts_a_path =
                |at: usize| !line[..at].ends_with(|c: char| c.is_alphanumeric() || "./_-})".contains(c));
            if line.match_indices(&wanted).any(|(at, _)| starts_a_path(at)) {
                offences.push(offence(path, number, &format!("names {wanted}, which only this machine has")));
            }
        }
    }
    offences
}

fn no_large_files() -> Outcome {
    let root = places::repository();
    let mut offences = Vec::new();
    for path in project_files(root)? {
        let bytes = fs::metadata(root.join(&path))?.len();
        let most = if path == Path::new(WEIGHTS) { lgs_train::ship::MAX_BYTES } else { MAX_BYTES };
        if usize::try_from(bytes)? > most {
            offences.push(offence(&path, 1, &format!("{bytes} bytes, at most {most}")));
        }
    }
    report(&offences)
}
