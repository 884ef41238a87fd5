//! Training: a run that was interrupted, threads, what is never read, steps that are skipped.

mod backbone;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    backbone::cases()
}
