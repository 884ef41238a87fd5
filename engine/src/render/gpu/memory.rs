//! How much a GPU may hold, how much it holds, and buffers that are kept from one work to the next.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use wgpu::Buffer;

use super::error::GpuError;

/// Bytes that true images may take where nobody says how much the GPU holds.
const KEPT_UNTOLD: u64 = 1 << 30;
/// What the share of the memory is divided by that true images may take.
const KEPT_SHARE: u64 = 4;

/// Bytes of a GPU. Counts are of buffers alone; wgpu does not tell how much memory there is.
#[derive(Debug)]
pub(super) struct Memory {
    /// Bytes that it may hold; `u64::MAX` where nobody says.
    limit: AtomicU64,
    /// Bytes that it holds.
    held: Arc<AtomicU64>,
}

/// A buffer that nobody else writes to, as long as it lives.
#[derive(Debug)]
pub(crate) struct Owned {
    buffer: Buffer,
    held: Arc<AtomicU64>,
}

impl Owned {
    /// The buffer.
    pub(crate) const fn buffer(&self) -> &Buffer {
        &self.buffer
    }

    /// Whether it is in this memory.
    pub(super) fn is_in(&self, memory: &Memory) -> bool {
        Arc::ptr_eq(&self.held, &memory.held)
    }
}

impl Drop for Owned {
    fn drop(&mut self) {
        self.held.fetch_sub(self.buffer.size(), Ordering::Relaxed);
    }
}

impl Default for Memory {
    fn default() -> Self {
        Self { limit: AtomicU64::new(u64::MAX), held: Arc::default() }
    }
}

impl Memory {
    /// Says how many bytes it may hold.
    pub(super) fn set_limit(&self, limit: u64) {
        self.limit.store(limit, Ordering::Relaxed);
    }

    /// Bytes that it may hold beside what it holds.
    pub(super) fn room(&self) -> u64 {
        self.limit.load(Ordering::Relaxed).saturating_sub(self.held.load(Ordering::Relaxed))
    }

    /// Bytes that true images may take.
    pub(super) fn most_kept(&self) -> u64 {
        match self.limit.load(Ordering::Relaxed) {
            u64::MAX => KEPT_UNTOLD,
            limit => limit / KEPT_SHARE,
        }
    }

    /// Fails where `need` more bytes than the `freed` ones are more than there is room for.
    ///
    /// # Errors
    /// [`GpuError::NoRoom`].
    pub(super) fn check(&self, what: &'static str, need: u64, freed: u64) -> Result<(), GpuError> {
        let room = self.room().saturating_add(freed);
        if need > room {
            return Err(GpuError::NoRoom { what, need, room, limit: self.limit.load(Ordering::Relaxed) });
        }
        Ok(())
    }

    /// Counts a new buffer, and those that it takes the place of.
    pub(super) fn count(&self, new: u64, freed: u64) {
        self.held.fetch_add(new, Ordering::Relaxed);
        self.held.fetch_sub(freed, Ordering::Relaxed);
    }

    /// A new buffer that is counted as long as it lives.
    pub(super) fn own(&self, buffer: Buffer) -> Owned {
        self.count(buffer.size(), 0);
        Owned { buffer, held: Arc::clone(&self.held) }
    }
}
