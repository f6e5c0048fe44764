//! Memory of this machine and of this process.

use std::fs;

const MB: u64 = 1 << 20;
/// Smallest memory that is left to the rest of the machine, MB.
///
/// The reserve is at least a tenth of the memory.
const RESERVE_MB: u64 = 512;

/// Memory that this process may use, MB: that of the control group or the machine, less a reserve.
///
/// `None` when the system does not report it.
#[must_use]
pub(super) fn allowed_mb() -> Option<u64> {
    let machine = in_kilobytes("/proc/meminfo", "MemTotal:");
    let group = ["/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"];
    let group = group
        .iter()
        .filter_map(|file| fs::read_to_string(file).ok()?.trim().parse::<u64>().ok())
        .map(|bytes| bytes / MB);
    let all = group.chain(machine.map(|kb| kb / 1024)).min()?;
    Some(all.saturating_sub(RESERVE_MB.max(all / 10)))
}

/// Resident memory of this process, MB.
#[must_use]
pub(super) fn used_mb() -> Option<u64> {
    in_kilobytes("/proc/self/status", "VmRSS:").map(|kb| kb / 1024)
}

fn in_kilobytes(file: &str, name: &str) -> Option<u64> {
    let text = fs::read_to_string(file).ok()?;
    text.lines().find(|line| line.starts_with(name))?.split_whitespace().nth(1)?.parse().ok()
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn a_process_uses_less_than_it_may() {
        let (used, allowed) = (used_mb().unwrap(), allowed_mb().unwrap());
        assert!(used > 0 && used < allowed, "{used} {allowed}");
    }
}
