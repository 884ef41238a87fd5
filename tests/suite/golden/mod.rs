//! Values that other implementations computed.

mod figures;
mod lpips;
mod render;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    [render::cases(), figures::cases(), lpips::cases()].into_iter().flatten().collect()
}
