//! The process's memory: an allocator that keeps its pages, and the peak of what was resident.

/// Bytes that the allocator asks the system for beyond what it needs, whenever it needs more.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const TOP_PAD_BYTES: libc::c_int = 256 << 20;

/// Buffers of this size are mappings of their own where memory goes back to the system, bytes.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const MAPPED_BYTES: libc::c_int = 256 << 10;

/// Tells glibc's allocator to keep freed pages, for the first line of a binary's `main`. Elsewhere nothing happens.
///
/// Tensor operations free and allocate the same large buffers again and again. By default each is a fresh mapping whose
/// pages fault in one by one, which costs more than the arithmetic on them. The price is that resident memory stays at
/// its peak until the process ends.
pub fn keep_pages() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    for (option, value) in
        [(libc::M_MMAP_MAX, 0), (libc::M_TRIM_THRESHOLD, libc::c_int::MAX), (libc::M_TOP_PAD, TOP_PAD_BYTES)]
    {
        set_option(option, value);
    }
}

/// Undoes [`keep_pages`]: from now on larger buffers are mappings of their own and go back to the system when they are freed, so that
/// resident memory is what is in use. For who looks at memory, not at time. Elsewhere nothing happens.
pub fn return_pages() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    for (option, value) in [
        (libc::M_MMAP_MAX, libc::c_int::MAX),
        (libc::M_MMAP_THRESHOLD, MAPPED_BYTES),
        (libc::M_TRIM_THRESHOLD, MAPPED_BYTES),
        (libc::M_TOP_PAD, 0),
    ] {
        set_option(option, value);
    }
}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[expect(unsafe_code, reason = "mallopt has no safe binding")]
fn set_option(option: libc::c_int, value: libc::c_int) {
    // SAFETY: mallopt takes two integers, keeps no pointer, takes the allocator's own lock, and refuses what it does not
    // know by returning 0, which leaves the default in place: slower, not wrong.
    unsafe {
        libc::mallopt(option, value);
    }
}

/// Gives back what is free now. Elsewhere than with glibc nothing happens.
pub fn trim() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    trim_arenas();
}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[expect(unsafe_code, reason = "malloc_trim has no safe binding")]
fn trim_arenas() {
    // SAFETY: malloc_trim takes an integer, keeps no pointer, takes the allocator's own locks, and moves nothing that is in use.
    unsafe {
        libc::malloc_trim(0);
    }
}

/// The largest resident memory of this process so far, in megabytes (10^6 bytes); `None` where the system does not say.
pub fn peak_rss_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    peak_from_status(&status)
}

/// Whether the peak that [`peak_rss_mb`] tells is, from now on, that of what comes: it starts again from what is resident.
pub fn reset_peak_rss() -> bool {
    std::fs::write("/proc/self/clear_refs", "5").is_ok()
}

/// Memory that this process can still get, bytes: what the system says is free, within the limits on the process and on its group;
/// `None` where the system does not say.
pub fn available_bytes() -> Option<u64> {
    let text = |path: &str| std::fs::read_to_string(path).ok();
    let free = text("/proc/meminfo").and_then(|page| kibibytes_of(&page, "MemAvailable:"));
    let used = text("/proc/self/status").and_then(|page| kibibytes_of(&page, "VmSize:")).unwrap_or(0);
    let space = text("/proc/self/limits").and_then(|page| address_space(&page)).map(|limit| limit.saturating_sub(used));
    let group = text("/sys/fs/cgroup/memory.max").and_then(|page| page.trim().parse().ok());
    [free, space, group].into_iter().flatten().min()
}

/// As [`available_bytes`]; where that is less than `need`, what was freed and kept is given back before it is told.
pub(crate) fn available_for(need: u64) -> Option<u64> {
    let at_once = available_bytes()?;
    if at_once >= need {
        return Some(at_once);
    }
    trim();
    available_bytes()
}

fn kibibytes_of(page: &str, key: &str) -> Option<u64> {
    let line = page.lines().find_map(|line| line.strip_prefix(key))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

fn address_space(page: &str) -> Option<u64> {
    page.lines().find_map(|line| line.strip_prefix("Max address space"))?.split_whitespace().next()?.parse().ok()
}

fn peak_from_status(status: &str) -> Option<f64> {
    let kibibytes: f64 =
        status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024.0 / 1e6)
}

#[cfg(test)]
mod tests {
    use super::peak_from_status;

    #[test]
    fn the_peak_is_read_in_kibibytes_and_given_in_megabytes() {
        let status = "Name:\tlgs\nVmPeak:\t  900000 kB\nVmHWM:\t  125000 kB\nVmRSS:\t  1000 kB\n";
        assert_eq!(peak_from_status(status), Some(128.0));
        assert_eq!(peak_from_status("Name:\tlgs\n"), None);
    }

    #[test]
    fn what_can_still_be_had_is_read_in_bytes() {
        assert_eq!(super::kibibytes_of("MemTotal: 9 kB\nMemAvailable:   22 kB\n", "MemAvailable:"), Some(22 * 1024));
        let limits = "Limit   Soft Limit   Hard Limit   Units\nMax address space    2048000    unlimited    bytes\n";
        assert_eq!(super::address_space(limits), Some(2_048_000));
        assert_eq!(super::address_space(&limits.replace("2048000", "unlimited")), None);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn the_peak_grows_by_what_is_touched() {
        let before = super::peak_rss_mb().unwrap();
        let touched = std::hint::black_box(vec![1_u8; 200_000_000]);
        let after = super::peak_rss_mb().unwrap();
        assert!(after >= 200.0 && after >= before, "before {before} MB, after {after} MB, touched {}", touched.len());
        drop(touched);
        assert!(super::reset_peak_rss());
        let restarted = super::peak_rss_mb().unwrap();
        assert!(restarted < after - 150.0, "after {after} MB, then {restarted} MB");
    }
}
