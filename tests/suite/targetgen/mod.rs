//! Training targets: signals against their twins and against reasoning, the job against interruptions.

mod closed_form;
mod deploy;
mod edges;
mod interruptions;
pub(crate) mod job;
mod problems;
mod twin;

use libtest_mimic::Trial;

pub(crate) use problems::config;

pub(crate) fn cases() -> Vec<Trial> {
    [twin::cases(), closed_form::cases(), edges::cases(), job::cases(), interruptions::cases(), deploy::cases()]
        .into_iter()
        .flatten()
        .collect()
}
