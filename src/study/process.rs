//! Processor time and memory of a process, read from `/proc`; `None` on systems without it.

use std::fs;

/// Processor time of all threads so far, s.
pub(super) fn cpu_s() -> Option<f64> {
    let mut sum = 0.0;
    for thread in fs::read_dir("/proc/self/task").ok()? {
        let text = fs::read_to_string(thread.ok()?.path().join("schedstat")).ok()?;
        sum += text.split_whitespace().next()?.parse::<f64>().ok()?;
    }
    Some(sum * 1e-9)
}

/// Resets the peak memory of this process.
pub(super) fn forget_peak() {
    // Without permission the peak includes earlier use, so the result may be too large but never too small.
    fs::write("/proc/self/clear_refs", "5").ok();
}

/// Resident memory of this process, MB.
pub(super) fn memory_mb() -> Option<f64> {
    status_mb("VmRSS:")
}

/// Peak resident memory of this process, MB; `None` on systems that do not report it.
#[must_use]
pub fn peak_mb() -> Option<f64> {
    status_mb("VmHWM:")
}

/// Resident memory of another process, MB.
pub(super) fn memory_of_mb(pid: u32) -> Option<f64> {
    status_of_mb(&format!("/proc/{pid}/status"), "VmRSS:")
}

fn status_mb(name: &str) -> Option<f64> {
    status_of_mb("/proc/self/status", name)
}

fn status_of_mb(file: &str, name: &str) -> Option<f64> {
    let status = fs::read_to_string(file).ok()?;
    let line = status.lines().find(|l| l.starts_with(name))?;
    // The file says kB but means units of 1024 bytes.
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? * 1.024e-3)
}
