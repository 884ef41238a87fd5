//! Values that other implementations computed.

mod figures;
mod knn;
mod lpips;
mod ptv3;
mod render;
mod sparse_conv;
mod spoilt;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    [
        render::cases(),
        figures::cases(),
        lpips::cases(),
        sparse_conv::cases(),
        knn::cases(),
        ptv3::cases(),
        spoilt::cases(),
    ]
    .into_iter()
    .flatten()
    .collect()
}
