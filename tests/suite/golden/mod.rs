//! Values that other implementations computed.

mod render;

use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    render::cases()
}
