//! Waymo's drives in both forms: what is in them, what is damaged, what is chosen.

mod damage;
mod drive;
mod real;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    [drive::cases(), damage::cases(), real::cases()].into_iter().flatten().collect()
}
