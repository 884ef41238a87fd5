//! What the suite and the benches share: places, goldens, comparisons, scenes, processes.

use std::time::Instant;

pub mod browser;
pub mod clips;
pub mod compare;
pub mod golden;
pub mod hostile;
pub mod hostile_models;
pub mod layouts;
pub mod metrics;
pub mod pictures;
pub mod places;
pub mod pods;
pub mod process;
pub mod random;
pub mod readme;
pub mod scenes;
pub mod slopes;
pub mod sources;
pub mod views;
pub mod weights;

/// Result of one case; the error is what the report prints.
pub type Outcome = Result<(), libtest_mimic::Failed>;

/// A case that runs.
#[expect(clippy::print_stderr, reason = "what a slow case takes stands between the lines of the report")]
pub fn case(name: impl Into<String>, body: impl FnOnce() -> Outcome + Send + 'static) -> libtest_mimic::Trial {
    let name = name.into();
    let told = name.clone();
    libtest_mimic::Trial::test(name, move || {
        let start = Instant::now();
        let outcome = body();
        let seconds = start.elapsed().as_secs_f64();
        if seconds >= SLOW_S {
            eprintln!("{seconds:.0} s: {told}");
        }
        outcome
    })
}

/// From so many seconds on a case says what it took, since all of them together have to stay below some minutes.
const SLOW_S: f64 = 5.0;

/// A case that runs when `needed` is there and shows as ignored, with what is missing as its kind, when it is not.
pub fn case_if(
    needed: &Needed,
    name: impl Into<String>,
    body: impl FnOnce() -> Outcome + Send + 'static,
) -> libtest_mimic::Trial {
    match needed {
        Needed::Here => case(name, body),
        Needed::Missing(what) => case(name, body).with_kind(format!("needs {what}")).with_ignored_flag(true),
    }
}

/// Whether what a case needs is on this machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Needed {
    /// It is.
    Here,
    /// It is not; the name of what is missing.
    Missing(String),
}

impl Needed {
    /// Whether a file or directory exists; `name` is how the report calls it.
    pub fn path(path: &std::path::Path, name: &str) -> Self {
        if path.exists() { Self::Here } else { Self::Missing(name.to_owned()) }
    }
}
