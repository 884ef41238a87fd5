//! Inputs at the extremes, and input that means harm: what must come out of each, and why. `README.md` is the table of the cases.

mod coordinates_and_time;
mod gaussians;
mod gradients;
mod hostile;
mod losses_and_metrics;
mod memory;
mod network;
mod properties;
mod resources;
mod set_update_and_targets;
mod table;
mod tiny;

use std::path::Path;

use lgs_tests::{Needed, Outcome, case, case_if};
use libtest_mimic::Trial;

use crate::gpu::adapter;

/// One extreme input.
#[derive(Clone, Copy, Debug)]
struct Extreme {
    /// Name within its group.
    name: &'static str,
    /// What goes in.
    input: &'static str,
    /// What must come out, and why.
    must: &'static str,
    /// What was mended so that it does; `None` where it always did.
    mended: Option<&'static str>,
    /// A file of the system without which the case cannot run.
    needs: Option<&'static str>,
    body: fn() -> Outcome,
}

impl Extreme {
    const fn new(name: &'static str, input: &'static str, must: &'static str, body: fn() -> Outcome) -> Self {
        Self { name, input, must, mended: None, needs: None, body }
    }

    const fn mended(self, how: &'static str) -> Self {
        Self { mended: Some(how), ..self }
    }

    const fn needing(self, file: &'static str) -> Self {
        Self { needs: Some(file), ..self }
    }

    fn case(&self, group: &str) -> Trial {
        let needed = self.needs.map_or(Needed::Here, |file| Needed::path(Path::new(file), file));
        case_if(&needed, format!("extremes::{group}::{}", self.name), self.body)
    }
}

/// Cases about one part of the program.
#[derive(Clone, Copy, Debug)]
struct Group {
    name: &'static str,
    cases: &'static [Extreme],
}

const GROUPS: [Group; 10] = [
    Group { name: "coordinates_and_time", cases: coordinates_and_time::CASES },
    Group { name: "gaussians", cases: gaussians::CASES },
    Group { name: "gradients", cases: gradients::CASES },
    Group { name: "network", cases: network::CASES },
    Group { name: "set_update_and_targets", cases: set_update_and_targets::CASES },
    Group { name: "losses_and_metrics", cases: losses_and_metrics::CASES },
    Group { name: "resources", cases: resources::CASES },
    Group { name: "memory", cases: memory::CASES },
    Group { name: "properties", cases: properties::CASES },
    Group { name: "hostile", cases: hostile::CASES },
];

/// `others` are the names of the suite's other cases, to which the table refers.
pub(crate) fn cases(others: Vec<String>) -> Vec<Trial> {
    let mut cases = Vec::new();
    for group in GROUPS {
        cases.extend(group.cases.iter().map(|one| one.case(group.name)));
    }
    let needed = adapter::needed();
    // Those that draw.
    let draws = |one: &&Extreme| !["is_not_written", "is_not_refined"].iter().any(|end| one.name.ends_with(end));
    for one in gaussians::CASES.iter().filter(draws) {
        let body = || tiny::on_gpu(one.body);
        cases.push(case_if(&needed, format!("gpu::extremes::{}", one.name), body));
    }
    cases.push(case("extremes::table_is_that_of_the_cases", move || table::check(&others)));
    cases
}

fn failed(error: impl std::fmt::Display) -> libtest_mimic::Failed {
    error.to_string().into()
}

/// Fails with the words of `what` unless it holds.
fn ensure(holds: bool, what: impl FnOnce() -> String) -> Outcome {
    if holds { Ok(()) } else { Err(what().into()) }
}

/// Fails unless every value is finite.
fn all_finite(what: &str, values: impl IntoIterator<Item = f32>) -> Outcome {
    match values.into_iter().enumerate().find(|(_, value)| !value.is_finite()) {
        None => Ok(()),
        Some((i, value)) => Err(format!("{what}[{i}] is {value}").into()),
    }
}
