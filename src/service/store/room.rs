//! Room on a disk that is kept free for deletions and for the ends of jobs.

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

use super::StoreError;

/// Local directories of a store, and how many bytes their disks keep free.
///
/// A database needs room even to delete rows. Below the limit, new sessions, uploads, jobs and results are refused.
#[derive(Debug, Default)]
pub(super) struct Room {
    pub(super) directories: Vec<PathBuf>,
    pub(super) least: AtomicU64,
}

/// Free bytes on the fullest disk of a store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FreeRoom {
    /// Bytes that this process may still write.
    pub bytes: u64,
    /// Bytes below which the store takes only reads and deletions.
    pub least: u64,
}

/// Room is low below this many times the limit.
const LOW: u64 = 4;

impl FreeRoom {
    /// Whether little is left above the limit once `more` bytes are written.
    #[must_use]
    pub fn is_low_after(self, more: u64) -> bool {
        self.bytes.saturating_sub(more) < self.least.saturating_mul(LOW)
    }
}

impl Room {
    /// Room on the fullest disk; `None` when nothing of the store is on a local disk.
    pub(super) fn free(&self) -> std::io::Result<Option<FreeRoom>> {
        let free = self.directories.iter().map(fs4::available_space).collect::<std::io::Result<Vec<u64>>>()?;
        let least = self.least.load(Ordering::Relaxed);
        Ok(free.into_iter().min().map(|bytes| FreeRoom { bytes, least }))
    }

    /// # Errors
    /// [`StoreError::NoRoom`] below the limit, else the disk's.
    pub(super) fn check(&self) -> Result<(), StoreError> {
        match self.free()? {
            Some(FreeRoom { bytes, least }) if bytes < least => Err(StoreError::NoRoom { bytes, least }),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disk_below_the_limit_has_no_room() {
        let directory = tempfile::tempdir().unwrap();
        let room = |least| Room { directories: vec![directory.path().to_owned()], least: AtomicU64::new(least) };
        room(1).check().unwrap();
        match room(u64::MAX).check() {
            Err(StoreError::NoRoom { bytes, least }) => assert!(bytes > 0 && least == u64::MAX, "{bytes}"),
            other => panic!("{other:?}"),
        }
        assert_eq!(Room::default().free().unwrap(), None);
        let left = FreeRoom { bytes: 100, least: 20 };
        assert_eq!([0, 20, 21, 200].map(|more| left.is_low_after(more)), [false, false, true, true]);
        let gone = Room { directories: vec![directory.path().join("gone")], ..Room::default() };
        assert!(matches!(gone.check(), Err(StoreError::Io(_))));
    }
}
