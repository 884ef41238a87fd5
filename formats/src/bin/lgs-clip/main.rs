//! `lgs-clip`: own data in, and what is in a clip.

mod args;
mod inspect;
mod run;

use std::process::ExitCode;

fn main() -> ExitCode {
    lgs_formats::program::run("lgs-clip", run::run)
}
