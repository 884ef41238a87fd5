//! `lgs-sweep`: clips in, a measured trade of time against accuracy out.

mod apart;
mod args;
mod grid_args;
mod progress;
mod run;
mod scaling;
mod scaling_args;
mod values;

use std::process::ExitCode;

fn main() -> ExitCode {
    lgs_engine::allocator::keep_pages();
    lgs_formats::program::run("lgs-sweep", run::run)
}
