//! The number of threads, for our own loops and for the tensor library alike.

use std::num::NonZeroUsize;

/// Variables from which rayon and candle take the sizes of their pools, each at its first use.
const POOL_VARIABLES: [&str; 2] = ["RAYON_NUM_THREADS", "CANDLE_NUM_THREADS"];

/// Other threads run already, or a pool exists already.
#[derive(Debug, thiserror::Error)]
#[error("--threads: expected a process of one thread, found {0}")]
pub struct TooLate(String);

/// Makes every pool of this process `count` threads large (all cores when `None`) and returns that number. To be called
/// once, in `main`, before anything starts a thread.
///
/// # Errors
/// When other threads run already, or a pool exists already.
pub fn set_num_threads(count: Option<NonZeroUsize>) -> Result<usize, TooLate> {
    set_pools(count, count)
}

/// As [`set_num_threads`] where the tensor library is to have a pool of another size: its threads wait by spinning, which slows down
/// whoever works beside them.
///
/// # Errors
/// As [`set_num_threads`].
pub fn set_pools(own: Option<NonZeroUsize>, tensors: Option<NonZeroUsize>) -> Result<usize, TooLate> {
    let or_all = |count: Option<NonZeroUsize>| match count {
        Some(count) => count.get(),
        None => std::thread::available_parallelism().map_or(1, NonZeroUsize::get),
    };
    if num_running().is_some_and(|running| running > 1) {
        return Err(TooLate("other threads running".to_owned()));
    }
    for (name, count) in POOL_VARIABLES.into_iter().zip([own, tensors]) {
        set_variable(name, &or_all(count).to_string());
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(or_all(own)).build_global();
    pool.map_err(|error| TooLate(error.to_string()))?;
    Ok(or_all(own))
}

/// Threads of this process; `None` where the system does not say.
fn num_running() -> Option<usize> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    status.lines().find_map(|line| line.strip_prefix("Threads:"))?.trim().parse().ok()
}

#[expect(unsafe_code, reason = "candle takes the size of its pools from the environment only")]
fn set_variable(name: &str, value: &str) {
    // SAFETY: nothing reads or writes the environment at the same time: the caller has made sure that this is the only
    // thread (by asking the system on Linux, by the contract of `set_num_threads` elsewhere).
    unsafe {
        std::env::set_var(name, value);
    }
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroUsize;

    #[test]
    #[cfg(target_os = "linux")]
    fn it_is_too_late_once_other_threads_run() {
        let (end, ended) = std::sync::mpsc::channel::<()>();
        let other = std::thread::spawn(move || ended.recv());
        let error = super::set_num_threads(NonZeroUsize::new(3)).unwrap_err().to_string();
        drop(end);
        assert!(other.join().unwrap().is_err());
        assert_eq!(error, "--threads: expected a process of one thread, found other threads running");
    }
}
