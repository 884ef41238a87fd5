//! The command line as a process.

mod flags;
mod hostile_clips;
mod infer;
mod real_clips;
mod scenes;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    [infer::cases(), flags::cases(), hostile_clips::cases(), real_clips::cases(), scenes::cases()]
        .into_iter()
        .flatten()
        .collect()
}
