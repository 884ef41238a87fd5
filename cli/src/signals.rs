//! Interrupts wait for the files that are being written: a program that is told to stop leaves whole files and no temporary ones.

use std::{
    io,
    sync::atomic::{AtomicBool, Ordering},
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

/// Lets an interrupt or a request to terminate end this process as it always does, but not while [`set_idle`] says that files are being
/// written.
///
/// # Errors
/// When the system takes no handlers.
pub(crate) fn wait_for_files() -> io::Result<()> {
    for (signal, asked) in SIGNALS.into_iter().zip(&ASKED) {
        flag::register(signal, asked)?;
        flag::register_conditional_default(signal, &IDLE)?;
    }
    Ok(())
}

/// Takes note of whether no file is being written. Ends the process where it was asked to stop before.
pub(crate) fn set_idle(idle: bool) {
    IDLE.store(idle, Ordering::SeqCst);
    if !idle {
        return;
    }
    for (signal, asked) in SIGNALS.into_iter().zip(&ASKED) {
        if asked.swap(false, Ordering::SeqCst) {
            // It ends the process; where it cannot, the work goes on as if nobody had asked.
            let _ = emulate_default_handler(signal);
        }
    }
}
