//! `lgs-infer`: a clip in, a dynamic Gaussian scene, its views and their figures out.

mod args;
mod output;
mod plan;
mod progress;
mod run;
mod summary;

use std::process::ExitCode;

fn main() -> ExitCode {
    lgs_engine::allocator::keep_pages();
    lgs_formats::program::run("lgs-infer", run::run)
}
