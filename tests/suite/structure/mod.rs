//! The layout of the repository: layers, file sizes, nothing that only exists on one machine.

mod circles;
mod files;
mod layers;
mod programs;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    [layers::cases(), circles::cases(), programs::cases(), files::cases()].into_iter().flatten().collect()
}
