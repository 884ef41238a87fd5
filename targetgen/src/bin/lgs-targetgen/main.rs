//! `lgs-targetgen`: clips in, shards of training targets out.

mod args;
mod fidelity;
mod progress;
mod run;

use std::{
    io::{self, ErrorKind, Write},
    process::ExitCode,
};

use clap::Parser;

/// Exit code of a job that came to its end with clips that failed.
const SOME_FAILED: u8 = 1;
/// Exit code of an error.
const ERROR: u8 = 2;

fn main() -> ExitCode {
    lgs_engine::allocator::keep_pages();
    let args = match args::Args::try_parse() {
        Ok(args) => args,
        Err(error) if error.use_stderr() => return fail(&usage(&error)),
        Err(help) => return finish(&format!("{}\n", help.to_string().trim_end()), ExitCode::SUCCESS),
    };
    match run::run(&args) {
        Ok(run::Finished { text, failed }) => {
            for clip in &failed {
                // When even that is impossible the exit code says it alone.
                let _ = writeln!(io::stderr(), "lgs-targetgen: {}: {}", clip.clip, clip.reason);
            }
            finish(&text, if failed.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(SOME_FAILED) })
        }
        Err(error) => fail(&chain(&error)),
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

/// Prints the error as one line.
fn fail(message: &str) -> ExitCode {
    let line: Vec<&str> = message.split_whitespace().collect();
    let _ = writeln!(io::stderr(), "lgs-targetgen: {}", line.join(" "));
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
    let text = error.to_string();
    let what = text.split("\n\n").next().unwrap_or(&text);
    format!("{} (see --help)", what.trim_start_matches("error: "))
}
