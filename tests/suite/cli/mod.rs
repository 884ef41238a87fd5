//! The command line as a process.

mod adam;
mod copying;
mod densify;
mod depth_maps;
mod describe;
mod film;
mod flags;
mod hostile_clips;
mod infer;
mod motion;
mod network;
mod plan;
mod real_clips;
mod scenes;
mod shipped;
mod untrained;
mod weights;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    [
        infer::cases(),
        motion::cases(),
        adam::cases(),
        shipped::cases(),
        flags::cases(),
        hostile_clips::cases(),
        real_clips::cases(),
        scenes::cases(),
        copying::cases(),
        densify::cases(),
        depth_maps::cases(),
        describe::cases(),
        film::cases(),
        network::cases(),
        plan::cases(),
        untrained::cases(),
        weights::cases(),
    ]
    .into_iter()
    .flatten()
    .collect()
}
