//! Matrix products whose operands stay in cache.
mod kernel;
pub(crate) use kernel::{Packed, Product, PANEL};
