//! Times of single returns and the motion within a sweep, from made streets and real folders to the scene.

mod foreign;
mod street;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    [street::cases(), foreign::cases()].into_iter().flatten().collect()
}
