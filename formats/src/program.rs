//! What every program of the project does around its work: the command line, what is printed, the exit code.

use std::error::Error;
use std::io::{self, ErrorKind, Write};
use std::process::ExitCode;

use clap::{Parser, error::ErrorKind as UsageError};

use crate::interrupt;

/// Exit code of a run that came to its end and found something to look at.
const FINDINGS: u8 = 1;
/// Exit code of an error.
const ERROR: u8 = 2;

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
pub fn run<A: Parser, O: Into<Outcome>, E: AsRef<dyn Error + Send + Sync>>(
    name: &str,
    act: impl FnOnce(&A) -> Result<O, E>,
) -> ExitCode {
    let args = match A::try_parse() {
        Ok(args) => args,
        Err(error) if error.use_stderr() => return fail(name, &usage(&error)),
        Err(help) => return finish(name, &help.to_string().into()),
    };
    if let Err(error) = interrupt::wait_for_files() {
        return fail(name, &format!("signals: {error}"));
    }
    match act(&args) {
        Ok(outcome) => finish(name, &outcome.into()),
        Err(error) => fail(name, &chain(error.as_ref())),
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

/// Prints a message as one line. When even that is impossible the exit code says it alone.
fn tell(name: &str, message: &str) {
    let line: Vec<&str> = message.split_whitespace().collect();
    let _ = writeln!(io::stderr(), "{name}: {}", line.join(" "));
}

/// The error and its causes, each once: some errors name their cause themselves.
fn chain(error: &(dyn Error + Send + Sync)) -> String {
    let (mut line, mut cause) = (error.to_string(), error.source());
    while let Some(next) = cause {
        let text = next.to_string();
        if !line.ends_with(&text) {
            line = line + ": " + &text;
        }
        cause = next.source();
    }
    line
}

/// What is wrong with the command line, without the usage that clap puts below it.
fn usage(error: &clap::Error) -> String {
    if error.kind() == UsageError::DisplayHelpOnMissingArgumentOrSubcommand {
        return "expected a command, found none (see --help)".to_owned();
    }
    let text = error.to_string();
    let what = text.split("\n\n").next().unwrap_or(&text);
    format!("{} (see --help)", what.trim_start_matches("error: "))
}

#[cfg(test)]
mod tests {
    use super::{chain, usage};

    #[test]
    fn a_cause_is_named_once() {
        let error = anyhow::anyhow!("no such file").context("clip.json: read: no such file").context("clip");
        assert_eq!(chain(error.as_ref()), "clip: clip.json: read: no such file");
    }

    #[test]
    fn a_refused_flag_is_one_line_without_the_usage_below_it() {
        #[derive(clap::Parser)]
        struct Args {}
        let error = <Args as clap::Parser>::try_parse_from(["program", "--no-such-flag"]).err().unwrap();
        assert_eq!(usage(&error), "unexpected argument '--no-such-flag' found (see --help)");
    }
}
