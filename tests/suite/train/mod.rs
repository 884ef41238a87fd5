//! Training: runs that were interrupted, threads, what is never read, steps that are skipped, what is learnt, what it is worth.

mod ablate;
mod backbone;
mod finetune;
mod fixtures;
mod policy;
mod validate;
mod weights;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    let all =
        [ablate::cases(), backbone::cases(), policy::cases(), finetune::cases(), validate::cases(), weights::cases()];
    all.into_iter().flatten().collect()
}
