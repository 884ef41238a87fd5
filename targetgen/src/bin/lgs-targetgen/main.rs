//! `lgs-targetgen`: clips in, shards of training targets out.

mod args;
mod fidelity;
mod progress;
mod run;

use std::process::ExitCode;

fn main() -> ExitCode {
    lgs_engine::allocator::keep_pages();
    lgs_formats::program::run("lgs-targetgen", run::run)
}
