//! The layout of the repository: layers, file sizes, nothing that only exists on one machine.

mod files;
mod layers;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    [layers::cases(), files::cases()].into_iter().flatten().collect()
}
