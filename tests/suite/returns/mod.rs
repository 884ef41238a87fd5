//! Returns: their times and the motion within a sweep, and what is no surface; from made streets and real folders to the scene.

mod foreign;
mod stamps;
mod strays;
mod street;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    [street::cases(), foreign::cases(), stamps::cases(), strays::cases()].into_iter().flatten().collect()
}
