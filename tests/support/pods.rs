//! Kubernetes jobs as shell scripts: what a pod of theirs runs, with the project's own program or one in its place.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::process::binary;
use crate::{Needed, Outcome};

/// Whether there is the shell that scripts of jobs ask for.
pub fn bash() -> Needed {
    let found = Command::new("bash").args(["-c", "true"]).status().is_ok_and(|status| status.success());
    if found { Needed::Here } else { Needed::Missing("bash".to_owned()) }
}

/// A job's file and the program that its pods run.
#[derive(Clone, Debug)]
pub struct Job {
    text: String,
    name: String,
    program: &'static str,
}

impl Job {
    /// The job in a file.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn read(file: &Path, program: &'static str) -> Result<Self, String> {
        let name = file.display().to_string();
        let text = fs::read_to_string(file).map_err(|e| format!("{name}: {e}"))?;
        Ok(Self { text, name, program })
    }

    /// What stands behind the first `key: `, without a comment and quotes.
    fn value(&self, key: &str) -> Result<&str, String> {
        value(&self.text, key).ok_or_else(|| format!("{}: no {key}", self.name))
    }

    /// What a pod's shell is given.
    fn script(&self) -> Result<&str, String> {
        Ok(self.value("args")?.trim_matches(['[', ']', '"']))
    }

    /// Fails unless the count that pods are told is the job's, and the policy's container is its own.
    pub fn expect_counts_and_names(&self) -> Outcome {
        let told = format!("name: JOB_COMPLETIONS, value: \"{}\"", self.value("completions")?);
        let containers = self.text.split_once("containers:").ok_or("no containers")?.1;
        let container = value(containers, "name").ok_or("a container without a name")?;
        let container = format!("containerName: {container},");
        for (name, wanted) in [("the count in the environment", &told), ("the container of the policy", &container)] {
            if !self.text.contains(wanted.as_str()) {
                return Err(format!("{}: {name}: {wanted} is missing", self.name).into());
            }
        }
        Ok(())
    }

    /// Fails unless what failed inside a job (1) is no failure of the pod and an error (2, a signal) is, under its own code.
    pub fn expect_exit_codes(&self) -> Outcome {
        let place = tempfile::tempdir()?;
        for (own, want) in [(0, 0), (1, 0), (2, 2), (137, 137)] {
            program(place.path(), self.program, &format!("exit {own}"))?;
            let got = with_path(Command::new("sh").args(["-c", self.script()?]), place.path())?.status.code();
            if got != Some(want) {
                return Err(format!("{}: exit {own} of the program became {got:?}, want {want}", self.name).into());
            }
        }
        Ok(())
    }

    /// Runs every pod of the job, the last one first, with `data` in the place of its volume and `changes` of its command line.
    pub fn run(&self, data: &Path, changes: &[(&str, &str)]) -> Outcome {
        let place = tempfile::tempdir()?;
        program(place.path(), self.program, &format!("exec {} \"$@\"", binary(self.program)?.display()))?;
        let mut script = self.script()?.to_owned();
        for (old, new) in [("/data", data.display().to_string().as_str())].iter().chain(changes) {
            if !script.contains(old) {
                return Err(format!("{}: no {old} in {script}", self.name).into());
            }
            script = script.replace(old, new);
        }
        let completions: Option<usize> = self.value("completions").ok().and_then(|count| count.parse().ok());
        for index in (0..completions.unwrap_or(1)).rev() {
            let mut command = Command::new("sh");
            command.args(["-c", &script]).current_dir(data);
            if let Some(completions) = completions {
                command.env("JOB_COMPLETION_INDEX", index.to_string()).env("JOB_COMPLETIONS", completions.to_string());
            }
            let output = with_path(&mut command, place.path())?;
            if !output.status.success() {
                let said = String::from_utf8_lossy(&output.stderr);
                return Err(format!("{}: pod {index}: {:?}: {said}", self.name, output.status.code()).into());
            }
        }
        Ok(())
    }
}

fn value<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let line =
        text.lines().find_map(|line| line.trim_start_matches([' ', '-', '{']).strip_prefix(key)?.strip_prefix(": "));
    line.map(str::trim)
}

/// A program of a name in a folder, which does what `script` says: its path.
///
/// # Errors
/// It cannot be written.
pub fn program(folder: &Path, name: &str, script: &str) -> std::io::Result<PathBuf> {
    let path = folder.join(name);
    fs::write(&path, format!("#!/bin/sh\n{script}\n"))?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755))?;
    }
    Ok(path)
}

/// Runs with a folder's programs before all others.
///
/// # Errors
/// It cannot be started.
pub fn with_path(command: &mut Command, folder: &Path) -> std::io::Result<Output> {
    let old = std::env::var("PATH").unwrap_or_default();
    command.env("PATH", format!("{}:{old}", folder.display())).output()
}
