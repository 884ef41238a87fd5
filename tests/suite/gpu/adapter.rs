//! The GPU that cases run on: a real one where there is one, else one that the processor plays.

use std::sync::OnceLock;

use lgs_engine::render::gpu::{Gpu, adapters, open};
use lgs_tests::Needed;

/// The GPU, where there is one.
///
/// # Errors
/// What a case that needs one waits for.
pub(crate) fn gpu() -> Result<&'static Gpu, Needed> {
    static OPENED: OnceLock<Result<&'static Gpu, Needed>> = OnceLock::new();
    let opened = || {
        let mut found = adapters();
        found.sort_by_key(|adapter| adapter.is_software);
        let first = found.first().ok_or_else(|| Needed::Missing("a GPU, or one that Mesa plays".to_owned()))?;
        open(first.index).map_err(|error| Needed::Missing(format!("a GPU that opens: {error}")))
    };
    OPENED.get_or_init(opened).clone()
}

/// Whether there is one.
pub(crate) fn needed() -> Needed {
    gpu().map_or_else(|needed| needed, |_| Needed::Here)
}
