//! `lgs-train`: makes scenes to train and measure on.

mod ablate;
mod ablate_args;
mod args;
mod backbone_args;
mod finetune_args;
mod policy_args;
mod rates;
mod rates_args;
mod run;
mod ship;
mod stage;
mod stage_args;

use std::process::ExitCode;

fn main() -> ExitCode {
    lgs_engine::allocator::keep_pages();
    lgs_formats::program::run("lgs-train", run::run)
}
