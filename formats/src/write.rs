//! Atomic writes: temporary name, sync, rename.
