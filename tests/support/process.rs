//! The project's binaries as processes.

use std::env;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;

use crate::{Outcome, places};

/// What a process left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finished {
    /// Exit code; `None` when a signal ended it.
    pub code: Option<i32>,
    /// What it printed.
    pub stdout: String,
    /// What it complained about.
    pub stderr: String,
}

/// The path of a binary of the workspace: in `$LGS_BIN_DIR` where that is set, else built with the suite's own profile first.
///
/// # Errors
/// The build fails, or makes no such binary.
pub fn binary(name: &str) -> Result<PathBuf, String> {
    static BUILT: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    let directory = BUILT.get_or_init(build_binaries).as_ref().map_err(Clone::clone)?;
    let path = directory.join(format!("{name}{}", env::consts::EXE_SUFFIX));
    if path.is_file() { Ok(path) } else { Err(format!("{}: no such binary after the build", path.display())) }
}

/// Builds every binary beside this one (`TARGET/PROFILE/deps/suite`). `cargo test` itself builds the binaries of packages
/// that have integration tests only. The suite is named beside them so that their dependencies have the features that they
/// have in `cargo test`, and none is compiled twice.
fn build_binaries() -> Result<PathBuf, String> {
    if let Some(given) = env::var_os("LGS_BIN_DIR") {
        return Ok(PathBuf::from(given));
    }
    let own = env::current_exe().map_err(|e| e.to_string())?;
    let directory = own.ancestors().nth(2).ok_or("this binary lies in no target directory")?;
    let target = directory.parent().ok_or("this binary lies in no target directory")?;
    let profile = match directory.file_name().and_then(OsStr::to_str) {
        Some("debug") | None => "dev",
        Some(name) => name,
    };
    let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    let what = ["build", "--bins", "--test", "suite", "--profile", profile];
    command.current_dir(places::repository()).args(what);
    command.arg("--target-dir").arg(target);
    let output = command.output().map_err(|e| format!("cargo build: {e}"))?;
    if !output.status.success() {
        return Err(format!("cargo build failed:\n{}", String::from_utf8_lossy(&output.stderr)));
    }
    Ok(directory.to_owned())
}

/// Runs a program to its end with nothing on its standard input.
///
/// # Errors
/// It cannot be started.
pub fn run<A: AsRef<OsStr>>(program: &Path, arguments: &[A], directory: &Path) -> Result<Finished, String> {
    let mut command = Command::new(program);
    command.args(arguments).current_dir(directory).stdin(Stdio::null());
    let output = command.output().map_err(|e| format!("{}: {e}", program.display()))?;
    Ok(finished(&output))
}

fn finished(output: &Output) -> Finished {
    Finished {
        code: output.status.code(),
        stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

impl Finished {
    /// Fails unless the process ended with code 0.
    pub fn expect_success(&self) -> Outcome {
        if self.code == Some(0) {
            return Ok(());
        }
        Err(format!("exit {:?}, want 0; it said:\n{}{}", self.code, self.stdout, self.stderr).into())
    }

    /// Fails unless the process refused its input: exit code 2 and exactly one line on stderr that holds every one of
    /// `names`.
    pub fn expect_refusal(&self, names: &[&str]) -> Outcome {
        let one_line = self.stderr.lines().count() == 1 && self.stderr.ends_with('\n');
        let missing: Vec<_> = names.iter().filter(|name| !self.stderr.contains(**name)).collect();
        if self.code == Some(2) && one_line && missing.is_empty() {
            return Ok(());
        }
        let text = format!(
            "exit {:?}, want 2; {} lines on stderr, want 1; not named: {missing:?}; it said:\n{}",
            self.code,
            self.stderr.lines().count(),
            self.stderr
        );
        Err(text.into())
    }

    /// Fails unless the process ended with code 2 and its last line on stderr, after those on its progress, is the program's own and
    /// holds every one of `names`.
    pub fn expect_one_line_at_the_end(&self, names: &[&str]) -> Outcome {
        let last = self.stderr.lines().last().unwrap_or_default();
        let missing: Vec<_> = names.iter().filter(|name| !last.contains(**name)).collect();
        if self.code == Some(2) && last.starts_with("lgs-") && missing.is_empty() {
            return Ok(());
        }
        Err(format!("exit {:?}, want 2; not named: {missing:?}; it said:\n{}", self.code, self.stderr).into())
    }
}
