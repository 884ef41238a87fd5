//! What measures: figures of time hold for one build on one machine only.

use std::path::Path;

use lgs_formats::{digest::sha256, error::FormatError};
use serde::{Deserialize, Serialize};

use super::error::Result;

/// The program and the machine that it runs on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Machine {
    /// Version of the program.
    pub version: String,
    /// `release`, or `debug` for a program that checks itself and whose times say nothing.
    pub build: String,
    /// SHA-256 of the program's file.
    pub program_sha256: String,
    /// Instruction set and operating system.
    pub target: String,
    /// What the processor calls itself; `None` where the system does not say.
    pub cpu: Option<String>,
    /// Cores that may be used.
    pub cores: usize,
    /// Threads that work.
    pub threads: usize,
}

impl Machine {
    /// This program, working with so many threads.
    ///
    /// # Errors
    /// When the program's file cannot be read.
    pub fn this(program: &Path, threads: usize) -> Result<Self> {
        let bytes = std::fs::read(program).map_err(|e| FormatError::io(program, "read", e))?;
        Ok(Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            build: if cfg!(debug_assertions) { "debug" } else { "release" }.to_owned(),
            program_sha256: sha256(&bytes),
            target: format!("{} {}", std::env::consts::ARCH, std::env::consts::OS),
            cpu: std::fs::read_to_string("/proc/cpuinfo").ok().as_deref().and_then(cpu_of),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            threads,
        })
    }
}

fn cpu_of(info: &str) -> Option<String> {
    let line = info.lines().find(|line| line.starts_with("model name"))?;
    line.split_once(':').map(|(_, name)| name.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::cpu_of;

    #[test]
    fn the_processor_is_the_first_that_has_a_name() {
        let info = "processor\t: 0\nmodel name\t: A CPU @ 2 GHz\nprocessor\t: 1\nmodel name\t: B\n";
        assert_eq!(cpu_of(info).as_deref(), Some("A CPU @ 2 GHz"));
        assert_eq!(cpu_of("processor\t: 0\n"), None);
    }
}
