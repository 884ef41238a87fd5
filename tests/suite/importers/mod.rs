//! Foreign layouts: what they become, the real folders where they are, what is refused, and what an inspection says.

mod additions;
mod fixtures;
mod hostile;
mod inspect;
mod real;
mod unusual;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    [additions::cases(), fixtures::cases(), real::cases(), hostile::cases(), inspect::cases(), unusual::cases()]
        .into_iter()
        .flatten()
        .collect()
}
