<<<<<<< HEAD
//! Training: runs that were interrupted, threads, what is never read, steps that are skipped, what is learnt.
=======
//! Training: a run that was interrupted, threads, what is never read, steps that are skipped; what the result is worth.
>>>>>>> ab

mod ablate;
mod backbone;
mod finetune;
mod fixtures;
mod policy;
mod weights;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
<<<<<<< HEAD
    [backbone::cases(), policy::cases(), finetune::cases(), weights::cases()].into_iter().flatten().collect()
=======
    [ablate::cases(), backbone::cases()].into_iter().flatten().collect()
>>>>>>> ab
}
