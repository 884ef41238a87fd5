//! A program from its command line to its exit code.

use std::{
    error::Error,
    io::{self, ErrorKind, Write},
    process::ExitCode,
};

use clap::Parser;

use crate::{
    message::{SettingOf, chain, tell, usage},
    signals,
};

/// Exit code of a run that came to its end and found something to look at.
const FINDINGS: u8 = 1;
/// Exit code of an error.
const ERROR: u8 = 2;

/// What a program says of itself.
#[derive(Clone, Copy, Debug)]
pub struct Program {
    /// Its name.
    pub name: &'static str,
    /// The setting that an error is about, as the error's text names it; `None` where it is about something else.
    pub setting: SettingOf,
    /// Takes a function that is to be told whether no file is being written, whenever that changes.
    pub observe_writing: fn(fn(bool)),
}

/// What a run that came to its end says.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// For standard output.
    pub text: String,
    /// Lines for standard error.
    pub notes: Vec<String>,
    /// Whether there is something to look at: exit code 1.
    pub has_findings: bool,
}

impl From<String> for Outcome {
    fn from(text: String) -> Self {
        Self { text, ..Self::default() }
    }
}

/// The exit code of a program's `main`: parses the command line, lets `act` work, prints its text, or its error as one line.
///
/// A reader of standard output that has seen enough and went away is no error.
pub fn run<A: Parser, O: Into<Outcome>, E: AsRef<dyn Error + Send + Sync + 'static>>(
    program: Program,
    act: impl FnOnce(&A) -> Result<O, E>,
) -> ExitCode {
    let name = program.name;
    let args = match A::try_parse() {
        Ok(args) => args,
        Err(error) if error.use_stderr() => return fail(name, &usage(&error)),
        Err(help) => return finish(name, &help.to_string().into()),
    };
    if let Err(error) = signals::wait_for_files() {
        return fail(name, &format!("signals: {error}"));
    }
    (program.observe_writing)(signals::set_idle);
    match act(&args) {
        Ok(outcome) => finish(name, &outcome.into()),
        Err(error) => fail(name, &chain(error.as_ref(), program.setting, &A::command())),
    }
}

fn finish(name: &str, outcome: &Outcome) -> ExitCode {
    for note in &outcome.notes {
        tell(name, note);
    }
    let code = if outcome.has_findings { ExitCode::from(FINDINGS) } else { ExitCode::SUCCESS };
    let mut out = io::stdout().lock();
    match writeln!(out, "{}", outcome.text.trim_end()).and_then(|()| out.flush()) {
        Ok(()) => code,
        Err(error) if error.kind() == ErrorKind::BrokenPipe => code,
        Err(error) => fail(name, &format!("standard output: {error}")),
    }
}

fn fail(name: &str, message: &str) -> ExitCode {
    tell(name, message);
    ExitCode::from(ERROR)
}
