//! `lgs-infer`: a clip in, a dynamic Gaussian scene, its views and their figures out.

mod args;
mod film;
mod output;
mod plan;
mod progress;
mod run;
mod summary;

use std::{error::Error, process::ExitCode};

use lgs_cli::Program;
use lgs_engine::error::EngineError;
use lgs_formats::error::FormatError;

fn main() -> ExitCode {
    lgs_engine::allocator::keep_pages();
    let program = Program { name: "lgs-infer", setting, observe_writing: lgs_formats::write::observe_writing };
    lgs_cli::run(program, run::run)
}

/// The setting that an error of the libraries is about.
fn setting<'e>(error: &'e (dyn Error + 'static)) -> Option<&'e str> {
    let of_formats = error.downcast_ref().and_then(FormatError::setting);
    of_formats.or_else(|| error.downcast_ref().and_then(EngineError::setting))
}
