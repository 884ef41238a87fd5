//! `lgs-infer`: a clip in, a dynamic Gaussian scene, its views and their figures out.

mod args;
mod output;
mod progress;
mod run;
mod summary;

use std::{
    io::{self, ErrorKind, Write},
    process::ExitCode,
};

use clap::Parser;

/// Exit code of an error; 1 is for a run that worked and found differences, which this program does not look for.
const ERROR: u8 = 2;

fn main() -> ExitCode {
    lgs_engine::allocator::keep_pages();
    let args = match args::Args::try_parse() {
        Ok(args) => args,
        Err(error) if error.use_stderr() => return fail(&usage(&error)),
        Err(help) => return finish(&format!("{}\n", help.to_string().trim_end())),
    };
    match run::run(&args) {
        Ok(text) => finish(&text),
        Err(error) => fail(&chain(&error)),
    }
}

/// Prints the result. A reader that has seen enough and went away is no error.
fn finish(text: &str) -> ExitCode {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if error.kind() == ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(error) => fail(&format!("standard output: {error}")),
    }
}

/// Prints the error as one line. When even that is impossible the exit code says it alone.
fn fail(message: &str) -> ExitCode {
    let line: Vec<&str> = message.split_whitespace().collect();
    let _ = writeln!(io::stderr(), "lgs-infer: {}", line.join(" "));
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

#[cfg(test)]
mod tests {
    use super::chain;

    #[test]
    fn a_cause_is_named_once() {
        let error = anyhow::anyhow!("no such file").context("clip.json: read: no such file").context("clip");
        assert_eq!(chain(&error), "clip: clip.json: read: no such file");
    }
}
