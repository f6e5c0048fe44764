//! Memory of this machine and of this process.

use std::fs;

const MB: u64 = 1 << 20;
/// Smallest memory that is left to the rest of the machine, MB.
///
/// The reserve is at least a tenth of the memory.
const RESERVE_MB: u64 = 512;

/// Smallest part of a limit of the process that is left to what no estimate counts, MB: stacks of new threads, the allocator's heaps.
///
/// At least a tenth of the limit is left.
const LIMIT_RESERVE_MB: u64 = 256;

/// Limits of the process (`/proc/self/limits`), with what counts for them (`/proc/self/status`).
///
/// An allocation beyond them fails, and a failed allocation ends the process.
const LIMITS: [(&str, &str); 2] = [("Max address space", "VmSize:"), ("Max data size", "VmData:")];

/// Memory that this process may use, MB: that of the control group or the machine, less a reserve.
///
/// `None` when the system does not report it.
#[must_use]
pub(super) fn allowed_mb() -> Option<u64> {
    let machine = fs::read_to_string("/proc/meminfo").ok().and_then(|text| in_kilobytes(&text, "MemTotal:"));
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
    in_kilobytes(&fs::read_to_string("/proc/self/status").ok()?, "VmRSS:").map(|kb| kb / 1024)
}

/// Memory that this process may still map before it meets a limit of its own (`ulimit -v`, `ulimit -d`), MB, less a reserve.
///
/// `None` without a limit.
#[must_use]
pub(super) fn left_of_limits_mb() -> Option<u64> {
    left_of(&fs::read_to_string("/proc/self/limits").ok()?, &fs::read_to_string("/proc/self/status").ok()?)
}

fn left_of(limits: &str, status: &str) -> Option<u64> {
    let left = |(limit, mapped): &(&str, &str)| {
        // The soft limit comes first, in bytes; `unlimited` is no number.
        let soft = limits.lines().find_map(|line| line.strip_prefix(limit))?.split_whitespace().next()?;
        let all = soft.parse::<u64>().ok()? / MB;
        let mapped = in_kilobytes(status, mapped)? / 1024;
        Some(all.saturating_sub(LIMIT_RESERVE_MB.max(all / 10)).saturating_sub(mapped))
    };
    LIMITS.iter().filter_map(left).min()
}

fn in_kilobytes(text: &str, name: &str) -> Option<u64> {
    text.lines().find_map(|line| line.strip_prefix(name))?.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn a_process_uses_less_than_it_may() {
        let (used, allowed) = (used_mb().unwrap(), allowed_mb().unwrap());
        assert!(used > 0 && used < allowed, "{used} {allowed}");
        let own = fs::read_to_string("/proc/self/limits").unwrap();
        assert!(LIMITS.iter().all(|(limit, _)| own.contains(limit)), "{own}");
        let status = fs::read_to_string("/proc/self/status").unwrap();
        assert!(LIMITS.iter().all(|(_, mapped)| in_kilobytes(&status, mapped).is_some()), "{status}");
    }

    #[test]
    fn the_nearest_limit_of_the_process_counts() {
        let status =
            "Name:\tprosopon\nVmPeak:\t 2097152 kB\nVmSize:\t 1048576 kB\nVmRSS:\t  80000 kB\nVmData:\t  524288 kB\n";
        let limits = |space: &str, data: &str| {
            format!(
                "Limit                     Soft Limit           Hard Limit           Units     \n\
                 Max cpu time              unlimited            unlimited            seconds   \n\
                 Max data size             {data:<20} unlimited            bytes     \n\
                 Max address space         {space:<20} unlimited            bytes     \n"
            )
        };
        let gb = |n: u64| (n << 30).to_string();
        for (space, data, left) in [
            ("unlimited".to_owned(), "unlimited".to_owned(), None),
            // 4096 MB less a tenth, less 1024 MB that are mapped.
            (gb(4), "unlimited".to_owned(), Some(4096 - 409 - 1024)),
            (gb(4), gb(2), Some(2048 - 256 - 512)),
            (gb(1), gb(8), Some(0)),
        ] {
            assert_eq!(left_of(&limits(&space, &data), status), left, "{space} {data}");
        }
        assert_eq!(left_of("", ""), None);
        assert_eq!(left_of(&limits(&gb(4), "x"), "VmSize: many"), None);
    }
}
