//! Range checks of configured values.

use crate::error::{Result, TrainError};

/// Both ends belong to the range.
#[derive(Clone, Copy, Debug)]
pub(super) struct Range(pub(super) f64, pub(super) f64);

/// Fails for a value out of its range.
///
/// # Errors
/// `value` is not a number in `range`.
pub(super) fn check(field: impl Into<String>, value: f64, range: Range) -> Result<()> {
    if value >= range.0 && value <= range.1 {
        return Ok(());
    }
    Err(TrainError::config(field, format!("{}..={}", range.0, range.1), value))
}
