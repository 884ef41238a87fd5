//! `lgs-clip`: own data in, and what is in a clip.

mod args;
mod inspect;
mod run;

use std::{error::Error, process::ExitCode};

use lgs_cli::Program;
use lgs_formats::error::FormatError;

fn main() -> ExitCode {
    let program = Program { name: "lgs-clip", setting, observe_writing: lgs_formats::write::observe_writing };
    lgs_cli::run(program, run::run)
}

/// The setting that an error of the libraries is about.
fn setting<'e>(error: &'e (dyn Error + 'static)) -> Option<&'e str> {
    error.downcast_ref().and_then(FormatError::setting)
}
