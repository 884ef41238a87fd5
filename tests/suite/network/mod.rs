//! The network as a whole: its gradient, and what it does before it is trained.

mod gradient;
mod untrained;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    [gradient::cases(), untrained::cases()].into_iter().flatten().collect()
}
