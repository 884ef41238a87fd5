//! The network as a whole: its gradients, both of its forms, what it does before it is trained, where its weights come from.

mod gradient;
mod policy;
mod refine;
mod scene;
mod untrained;
mod weights;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    [gradient::cases(), untrained::cases(), policy::cases(), refine::cases(), weights::cases()]
        .into_iter()
        .flatten()
        .collect()
}
