//! Drawing, losses and gradients on a GPU against the CPU's; cases show as ignored where there is none.

pub(crate) mod adapter;
mod objective;
mod programs;
mod scenes;

use lgs_tests::{Outcome, case_if};
use libtest_mimic::Trial;

/// A case's name and body.
type Case = (&'static str, fn() -> Outcome);

pub(crate) fn cases() -> Vec<Trial> {
    let needed = adapter::needed();
    let all: Vec<Case> = [scenes::CASES, objective::CASES, programs::CASES].concat();
    all.into_iter().map(|(name, body)| case_if(&needed, format!("gpu::{name}"), body)).collect()
}

/// Numbers, a GPU's and the CPU's, with the largest relative L2 distance that is allowed.
fn near(what: &str, got: &[f32], want: &[f32], tolerance: f64) -> Outcome {
    let wide = |values: &[f32]| values.iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
    lgs_tests::compare::close_l2(what, &wide(got), &wide(want), tolerance, 0.0)
}
