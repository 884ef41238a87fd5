//! Training: a run that was interrupted, threads, what is never read, steps that are skipped; what the result is worth.

mod ablate;
mod backbone;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    [ablate::cases(), backbone::cases()].into_iter().flatten().collect()
}
