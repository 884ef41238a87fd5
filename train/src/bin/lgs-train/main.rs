//! `lgs-train`: makes scenes. Exit codes: 0 done, 2 error with one line on standard error.

mod args;
mod run;

use std::{
    io::{ErrorKind, Write},
    process::ExitCode,
};

use clap::Parser;

fn main() -> ExitCode {
    let cli = args::Cli::parse();
    match run::run(&cli) {
        Ok(text) => match writeln!(std::io::stdout(), "{text}") {
            Err(e) if e.kind() != ErrorKind::BrokenPipe => ExitCode::from(2),
            _ => ExitCode::SUCCESS,
        },
        Err(error) => {
            // Nothing can be done about a standard error that cannot be written to.
            let _unwritable = writeln!(std::io::stderr(), "lgs-train: {error:#}");
            ExitCode::from(2)
        }
    }
}
