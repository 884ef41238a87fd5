//! How many files are being written, for programs that wait for them before they stop.

use std::sync::{Mutex, OnceLock, PoisonError};

/// Files that are being written.
static COUNT: Mutex<usize> = Mutex::new(0);
/// Who is told.
static OBSERVER: OnceLock<fn(bool)> = OnceLock::new();

/// Tells `observer` from now on whether no file is being written, whenever that changes. The first observer of a process stays.
pub fn observe_writing(observer: fn(idle: bool)) {
    // A program sets it once, before its work.
    let _ = OBSERVER.set(observer);
}

/// A file, or a folder of files, that is being written, from before its temporary name is made until it is gone.
#[derive(Debug)]
pub(crate) struct Unfinished(());

impl Unfinished {
    pub(crate) fn new() -> Self {
        let mut count = COUNT.lock().unwrap_or_else(PoisonError::into_inner);
        *count += 1;
        tell(false);
        Self(())
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        let mut count = COUNT.lock().unwrap_or_else(PoisonError::into_inner);
        *count -= 1;
        if *count == 0 {
            tell(true);
        }
    }
}

fn tell(idle: bool) {
    if let Some(observer) = OBSERVER.get() {
        observer(idle);
    }
}
