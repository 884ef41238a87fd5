//! Foreign layouts: what they become, the real folders where they are, what is refused, what is left out, and what an inspection says.

mod additions;
mod fixtures;
mod hostile;
mod inspect;
mod partial;
mod real;
mod small;
mod unusual;
mod waymo;
mod wrong;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    [
        additions::cases(),
        fixtures::cases(),
        real::cases(),
        hostile::cases(),
        inspect::cases(),
        partial::cases(),
        small::cases(),
        unusual::cases(),
        waymo::cases(),
        wrong::cases(),
    ]
    .into_iter()
    .flatten()
    .collect()
}
