//! The one test binary of the workspace. Cases that cannot run on this machine show as ignored, never as passed.

mod cli;
mod density;
mod eval;
mod extremes;
mod golden;
mod gpu;
mod importers;
mod install;
mod network;
mod readers;
mod readme;
mod render;
mod returns;
mod rig;
mod scaling;
mod shutters;
mod street;
mod structure;
mod sweep;
mod targetgen;
mod train;
mod viewer;

use std::process::ExitCode;

use libtest_mimic::{Arguments, Trial};

fn main() -> ExitCode {
    let arguments = Arguments::from_args();
    let mut cases: Vec<Trial> = Vec::new();
    cases.extend(golden::cases());
    cases.extend(render::cases());
    cases.extend(gpu::cases());
    cases.extend(network::cases());
    cases.extend(train::cases());
    cases.extend(structure::cases());
    cases.extend(importers::cases());
    cases.extend(returns::cases());
    cases.extend(rig::cases());
    cases.extend(shutters::cases());
    cases.extend(cli::cases());
    cases.extend(density::cases());
    cases.extend(targetgen::cases());
    cases.extend(scaling::cases());
    cases.extend(sweep::cases());
    cases.extend(eval::cases());
    cases.extend(viewer::cases());
    cases.extend(readers::cases());
    cases.extend(readme::cases());
    cases.extend(install::cases());
    let others = cases.iter().map(|case| case.name().to_owned()).collect();
    cases.extend(extremes::cases(others));
    libtest_mimic::run(&arguments, cases).exit_code()
}
