//! `lgs-clip`: own data in, and what is in a clip.

mod args;
mod inspect;
mod run;

use std::{
    io::{self, ErrorKind, Write},
    process::ExitCode,
};

use clap::{Parser, error::ErrorKind as UsageError};

/// Exit code of an inspection that found something to look at.
const FOUND: u8 = 1;
/// Exit code of an error.
const ERROR: u8 = 2;

fn main() -> ExitCode {
    let args = match args::Args::try_parse() {
        Ok(args) => args,
        Err(error) if error.use_stderr() => return fail(&usage(&error)),
        Err(help) => return finish(&format!("{}\n", help.to_string().trim_end()), ExitCode::SUCCESS),
    };
    match run::run(&args) {
        Ok(done) => finish(&done.text, if done.has_findings { ExitCode::from(FOUND) } else { ExitCode::SUCCESS }),
        Err(error) => fail(&format!("{error:#}")),
    }
}

/// Prints the result. A reader that has seen enough and went away is no error.
fn finish(text: &str, code: ExitCode) -> ExitCode {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Ok(()) => code,
        Err(error) if error.kind() == ErrorKind::BrokenPipe => code,
        Err(error) => fail(&format!("standard output: {error}")),
    }
}

/// Prints the error as one line. When even that is impossible the exit code says it alone.
fn fail(message: &str) -> ExitCode {
    let line: Vec<&str> = message.split_whitespace().collect();
    let _ = writeln!(io::stderr(), "lgs-clip: {}", line.join(" "));
    ExitCode::from(ERROR)
}

/// What is wrong with the command line, without the usage that clap puts below it.
fn usage(error: &clap::Error) -> String {
    if error.kind() == UsageError::DisplayHelpOnMissingArgumentOrSubcommand {
        return "expected a command, found none (see --help)".to_owned();
    }
    let text = error.to_string();
    let what = text.split("\n\n").next().unwrap_or(&text);
    format!("{} (see --help)", what.trim().trim_start_matches("error: "))
}
