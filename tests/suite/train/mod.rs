//! Training: runs that were interrupted, threads, what is never read, steps that are skipped, what is learnt.

mod backbone;
mod finetune;
mod fixtures;
mod policy;
mod weights;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    [backbone::cases(), policy::cases(), finetune::cases(), weights::cases()].into_iter().flatten().collect()
}
