//! The repository's own files, and where their code names something.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A file with a line that breaks a rule: `path:line: what`.
pub fn offence(path: &Path, line: usize, what: &str) -> String {
    format!("{}:{line}: {what}", path.display())
}

/// The files under `root` that belong to the project, relative to it, sorted: what git does not ignore, or everything where
/// `root` is no git repository.
///
/// # Errors
/// A directory cannot be read.
pub fn project_files(root: &Path) -> Result<Vec<PathBuf>, String> {
    let mut files = match tracked_files(root) {
        Some(files) => files,
        None => all_files(root)?,
    };
    files.retain(|path| root.join(path).is_file());
    files.sort();
    Ok(files)
}

fn tracked_files(root: &Path) -> Option<Vec<PathBuf>> {
    let list = ["ls-files", "-z", "--cached", "--others", "--exclude-standard"];
    let output = Command::new("git").arg("-C").arg(root).args(list).output().ok()?;
    let names = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| names.split_terminator('\0').map(PathBuf::from).collect())
}

/// Every file under `root`, relative to it.
///
/// # Errors
/// A directory cannot be read.
pub fn all_files(root: &Path) -> Result<Vec<PathBuf>, String> {
    let mut found = Vec::new();
    let mut open = vec![PathBuf::new()];
    while let Some(directory) = open.pop() {
        let full = root.join(&directory);
        for entry in fs::read_dir(&full).map_err(|e| format!("{}: {e}", full.display()))?.flatten() {
            let path = directory.join(entry.file_name());
            if entry.path().is_dir() { open.push(path) } else { found.push(path) }
        }
    }
    Ok(found)
}

/// The Rust files among `files`.
pub fn rust_files(files: &[PathBuf]) -> Vec<&PathBuf> {
    files.iter().filter(|path| path.extension().is_some_and(|e| e == "rs")).collect()
}

/// Rust text without line comments, line by line.
pub fn code_of(text: &str) -> String {
    text.lines().map(|line| line.split("//").next().unwrap_or_default()).collect::<Vec<_>>().join("\n")
}

/// A name that follows a path prefix such as `crate::`, and the line it stands on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Named {
    /// What follows the prefix: its first segment, or the whole path.
    pub name: String,
    /// Line, from 1.
    pub line: usize,
}

/// Every first segment that follows `prefix` in `code`, also inside `prefix{a::b, c}`.
pub fn names_after(code: &str, prefix: &str) -> Vec<Named> {
    let mut names = Vec::new();
    for (at, _) in code.match_indices(prefix) {
        let whole_word = !code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':');
        if whole_word {
            names_at(code, at + prefix.len(), &mut names);
        }
    }
    names
}

fn names_at(code: &str, start: usize, names: &mut Vec<Named>) {
    let line_at = |offset: usize| 1 + code[..offset].matches('\n').count();
    if !code[start..].starts_with('{') {
        names.push(Named { name: segment(&code[start..]), line: line_at(start) });
        return;
    }
    let mut depth = 0_usize;
    let mut expects_name = false;
    for (offset, c) in code[start..].char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return;
        }
        if depth == 1 && expects_name && !c.is_whitespace() && c != '}' {
            names.push(Named { name: segment(&code[start + offset..]), line: line_at(start + offset) });
            expects_name = false;
        }
        expects_name |= depth == 1 && (c == ',' || c == '{');
    }
}

/// Every whole path that follows `prefix` in `code`, such as `a::b::C`; groups `prefix{a::{b, c}}` are taken apart.
pub fn paths_after(code: &str, prefix: &str) -> Vec<Named> {
    let mut paths = Vec::new();
    for (at, _) in code.match_indices(prefix) {
        let whole_word = !code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':');
        if whole_word {
            let line = 1 + code[..at].matches('\n').count();
            let mut found = Vec::new();
            flatten(&mut code[at + prefix.len()..].chars().peekable(), "", &mut found);
            paths.extend(found.into_iter().map(|name| Named { name, line }));
        }
    }
    paths
}

/// The paths of a use tree behind `base`, up to its end.
fn flatten(text: &mut std::iter::Peekable<std::str::Chars<'_>>, base: &str, found: &mut Vec<String>) {
    let mut path = base.to_owned();
    while let Some(&c) = text.peek() {
        match c {
            '{' => {
                text.next();
                loop {
                    while text.peek().is_some_and(|c| c.is_whitespace() || *c == ',') {
                        text.next();
                    }
                    match text.peek() {
                        None => return,
                        Some('}') => {
                            text.next();
                            return;
                        }
                        Some(c) if !(c.is_alphanumeric() || "_{*".contains(*c)) => return,
                        Some(_) => flatten(text, &path, found),
                    }
                }
            }
            c if c.is_alphanumeric() || c == '_' || c == ':' || c == '*' => {
                path.push(c);
                text.next();
            }
            _ => break,
        }
    }
    // A name that is given another one: `a as b`.
    let mut rest = text.clone();
    if rest.by_ref().take(4).collect::<String>() == " as " {
        *text = rest;
        while text.peek().is_some_and(|c| c.is_alphanumeric() || *c == '_') {
            text.next();
        }
    }
    if path.len() > base.len() {
        found.push(path);
    }
}

fn segment(text: &str) -> String {
    text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
}
