//! `lgs-eval`: whole drives in, their figures by a protocol out.

mod args;
mod progress;
mod recipe;
mod run;

use std::{error::Error, process::ExitCode};

use lgs_cli::Program;
use lgs_engine::error::EngineError;
use lgs_formats::error::FormatError;
use lgs_measure::error::MeasureError;

fn main() -> ExitCode {
    lgs_engine::allocator::keep_pages();
    let program = Program { name: "lgs-eval", setting, observe_writing: lgs_formats::write::observe_writing };
    lgs_cli::run(program, run::run)
}

/// The setting that an error of the libraries is about.
fn setting<'e>(error: &'e (dyn Error + 'static)) -> Option<&'e str> {
    let of_formats = error.downcast_ref().and_then(FormatError::setting);
    of_formats
        .or_else(|| error.downcast_ref().and_then(EngineError::setting))
        .or_else(|| error.downcast_ref().and_then(MeasureError::setting))
}
