//! Why something was not done on a GPU.

/// Why something was not done on a GPU.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GpuError {
    /// It does not fit.
    #[error("{what} would take {} MB where the GPU holds at most {} MB at once", .need.div_ceil(1_000_000), .limit / 1_000_000)]
    TooLarge {
        /// What was to be held.
        what: &'static str,
        /// Bytes that it takes.
        need: u64,
        /// Bytes that one piece of the GPU's memory may have.
        limit: u64,
    },
    /// It does not fit beside what the GPU holds already.
    #[error("{what} would take {} MB where {} MB are left of the {} MB that the GPU may hold: a smaller image size or a larger coarseness takes less", .need.div_ceil(1_000_000), .room / 1_000_000, .limit / 1_000_000)]
    NoRoom {
        /// What was to be held.
        what: &'static str,
        /// Bytes that it takes.
        need: u64,
        /// Bytes that are left.
        room: u64,
        /// Bytes that the GPU may hold.
        limit: u64,
    },
    /// It stopped, or its memory ran out.
    #[error("the GPU stopped: {0}")]
    Lost(String),
    /// It could not be opened.
    #[error("{0}")]
    NotOpened(String),
}
