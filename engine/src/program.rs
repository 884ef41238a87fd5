//! What every program of the project does around its work: memory, the command line, what is printed, the exit code.

use std::error::Error;
use std::io::{self, ErrorKind, Write};
use std::process::ExitCode;

use clap::{Parser, error::ErrorKind as UsageError};

use crate::allocator;

/// Exit code of an error; 1 is kept for runs that work and find differences.
const ERROR: u8 = 2;

/// The exit code of a program's `main`: parses the command line, lets `act` work, prints its text, or its error as one line.
///
/// A reader of standard output that has seen enough and went away is no error.
pub fn run<A: Parser, E: AsRef<dyn Error + Send + Sync>>(
    name: &str,
    act: impl FnOnce(&A) -> Result<String, E>,
) -> ExitCode {
    allocator::keep_pages();
    let args = match A::try_parse() {
        Ok(args) => args,
        Err(error) if error.use_stderr() => return fail(name, &usage(&error)),
        Err(help) => return finish(name, &help.to_string()),
    };
    match act(&args) {
        Ok(text) => finish(name, &text),
        Err(error) => fail(name, &chain(error.as_ref())),
    }
}

fn finish(name: &str, text: &str) -> ExitCode {
    let mut out = io::stdout().lock();
    match writeln!(out, "{}", text.trim_end()).and_then(|()| out.flush()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if error.kind() == ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(error) => fail(name, &format!("standard output: {error}")),
    }
}

/// Prints the error. When even that is impossible the exit code says it alone.
fn fail(name: &str, message: &str) -> ExitCode {
    let line: Vec<&str> = message.split_whitespace().collect();
    let _ = writeln!(io::stderr(), "{name}: {}", line.join(" "));
    ExitCode::from(ERROR)
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
