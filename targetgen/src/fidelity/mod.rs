//! How well the signals tell the true effect of single actions: at once, and after everything was optimised for a few steps.

mod after;
mod at_once;
mod rank;
mod sample;
mod table;

pub use after::{AfterSettings, after};
pub use at_once::at_once;
pub use rank::{Correlation, rank_correlation, sign_agreement};
pub use sample::{SIGNALS, Sample, SignalDeltas, SignalName};
pub use table::{CorrelationRow, pairs, pictures, rows, table};

/// What single actions did to the loss; negative where they helped.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Effects {
    /// `[M]` of taking the primitive out.
    pub prune: Vec<f64>,
    /// `[M]` of a copy.
    pub add: Vec<f64>,
}
