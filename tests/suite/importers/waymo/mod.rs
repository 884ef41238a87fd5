//! Waymo's drives in both forms: what is in them, what is damaged, what is chosen.

mod component;
mod damage;
mod drive;
mod real;
mod table;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    [drive::cases(), damage::cases(), real::cases(), component::cases()].into_iter().flatten().collect()
}
