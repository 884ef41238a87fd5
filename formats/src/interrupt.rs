//! Interrupts wait for the files that are being written: a program that is told to stop leaves whole files and no temporary ones.

use std::{
    io,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
};

use signal_hook::{
    consts::signal::{SIGINT, SIGTERM},
    flag,
    low_level::emulate_default_handler,
};

/// What asks a program to stop.
const SIGNALS: [i32; 2] = [SIGINT, SIGTERM];

/// Whether no file is being written: a signal then ends the program at once.
static IDLE: AtomicBool = AtomicBool::new(true);
/// Which of the signals came while a file was being written.
static ASKED: [AtomicBool; 2] = [AtomicBool::new(false), AtomicBool::new(false)];
/// Files that are being written.
static UNFINISHED: Mutex<usize> = Mutex::new(0);

/// Nothing: from now on an interrupt or a request to terminate ends this process as it always does, but not before the files that are
/// being written have their names.
///
/// # Errors
/// When the system takes no handlers.
pub fn wait_for_files() -> io::Result<()> {
    for (signal, asked) in SIGNALS.into_iter().zip(&ASKED) {
        flag::register(signal, asked)?;
        flag::register_conditional_default(signal, &IDLE)?;
    }
    Ok(())
}

/// A file, or a folder of files, that is being written, from before its temporary name is made until it is gone.
#[derive(Debug)]
pub(crate) struct Unfinished(());

impl Unfinished {
    pub(crate) fn new() -> Self {
        let mut count = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        *count += 1;
        IDLE.store(false, Ordering::SeqCst);
        Self(())
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        let mut count = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        *count -= 1;
        if *count > 0 {
            return;
        }
        IDLE.store(true, Ordering::SeqCst);
        for (signal, asked) in SIGNALS.into_iter().zip(&ASKED) {
            if asked.swap(false, Ordering::SeqCst) {
                // It ends the process; where it cannot, the work goes on as if nobody had asked.
                let _ = emulate_default_handler(signal);
            }
        }
    }
}
