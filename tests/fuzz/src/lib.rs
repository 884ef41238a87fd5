//! Readers of files from outside as fuzz targets: `cargo +nightly fuzz run TARGET`, see `README.md`.

use std::path::Path;

#[path = "../../support/hostile/mod.rs"]
pub mod hostile;
#[cfg(feature = "models")]
#[path = "../../support/hostile_models.rs"]
pub mod hostile_models;

use hostile::{Stage, Target};

thread_local! {
    static STAGE: std::cell::OnceCell<Stage> = const { std::cell::OnceCell::new() };
}

/// Gives the input to the target of this name, which reads it or says what is wrong with it.
///
/// # Panics
/// When there is no such target, its good folder cannot be made, or the target breaks a promise.
pub fn run(name: &str, input: &[u8]) {
    STAGE.with(|stage| {
        let _ = stage.get_or_init(|| stage_of(name)).run(input);
    });
}

/// The targets of this build.
pub fn targets() -> Vec<Target> {
    #[cfg(feature = "models")]
    let models: &[Target] = &hostile_models::TARGETS;
    #[cfg(not(feature = "models"))]
    let models: &[Target] = &[];
    [&hostile::TARGETS, models].concat()
}

/// The folder of a target.
///
/// # Panics
/// When there is no such target or its good folder cannot be made.
pub fn stage_of(name: &str) -> Stage {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let target = targets().into_iter().find(|target| target.name == name);
    let target = target.unwrap_or_else(|| panic!("no target {name}"));
    Stage::new(&target, &repository).unwrap_or_else(|error| panic!("{error}"))
}
