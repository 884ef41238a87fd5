//! `lgs-train`: makes scenes to train and measure on.

mod args;
mod backbone;
mod backbone_args;
mod run;

use std::{
    io::{self, ErrorKind, Write},
    process::ExitCode,
};

use clap::{Parser, error::ErrorKind as UsageError};

/// Exit code of an error.
const ERROR: u8 = 2;

fn main() -> ExitCode {
    lgs_engine::allocator::keep_pages();
    let cli = match args::Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => return fail(&usage(&error)),
        Err(help) => return finish(help.to_string().trim_end()),
    };
    match run::run(&cli) {
        Ok(text) => finish(&text),
        Err(error) => fail(&chain(&error)),
    }
}

/// Prints the result. A reader that has seen enough and went away is no error.
fn finish(text: &str) -> ExitCode {
    let mut out = io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if error.kind() == ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(error) => fail(&format!("standard output: {error}")),
    }
}

/// Prints the error as one line. When even that is impossible the exit code says it alone.
fn fail(message: &str) -> ExitCode {
    let line: Vec<&str> = message.split_whitespace().collect();
    let _ = writeln!(io::stderr(), "lgs-train: {}", line.join(" "));
    ExitCode::from(ERROR)
}

/// The error and its causes, each once: some errors name their cause themselves.
fn chain(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |line, cause| {
        let separator = if line.is_empty() { "" } else { ": " };
        if line.ends_with(&cause) { line } else { line + separator + &cause }
    })
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
