//! Values that other implementations computed.

mod figures;
mod knn;
mod lpips;
mod render;
mod sparse_conv;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    [render::cases(), figures::cases(), lpips::cases(), sparse_conv::cases(), knn::cases()]
        .into_iter()
        .flatten()
        .collect()
}
