//! What the system says about this process; nothing on systems that do not say it.

use std::fs;

/// Time on processors of all threads so far, s.
pub(super) fn cpu_s() -> Option<f64> {
    let mut sum = 0.0;
    for thread in fs::read_dir("/proc/self/task").ok()? {
        let text = fs::read_to_string(thread.ok()?.path().join("schedstat")).ok()?;
        sum += text.split_whitespace().next()?.parse::<f64>().ok()?;
    }
    Some(sum * 1e-9)
}

/// Starts a new record of the largest memory.
pub(super) fn forget_peak() {
    // Without the right to do so the record keeps what the process needed so far, which is too much, never too little.
    fs::write("/proc/self/clear_refs", "5").ok();
}

/// Memory in use, MB.
pub(super) fn memory_mb() -> Option<f64> {
    status_mb("VmRSS:")
}

/// Largest memory that this process had in use, MB; `None` on systems that do not say it.
#[must_use]
pub fn peak_mb() -> Option<f64> {
    status_mb("VmHWM:")
}

/// Memory in use by another process, MB.
pub(super) fn memory_of_mb(pid: u32) -> Option<f64> {
    status_of_mb(&format!("/proc/{pid}/status"), "VmRSS:")
}

fn status_mb(name: &str) -> Option<f64> {
    status_of_mb("/proc/self/status", name)
}

fn status_of_mb(file: &str, name: &str) -> Option<f64> {
    let status = fs::read_to_string(file).ok()?;
    let line = status.lines().find(|l| l.starts_with(name))?;
    // In units of 1024 bytes, whatever it says.
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? * 1.024e-3)
}
