//! The data directory of a process.

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

use super::StoreError;

/// Directory of the blobs.
pub(super) const BLOBS: &str = "blobs";
/// File that a process locks while it has the directory open.
const LOCK: &str = "lock";
/// File in a directory into which a store is being copied.
const UNFINISHED: &str = "unfinished";

/// Name of the audit log when the rows are in the same directory.
pub(super) const LOCAL_LOG: &str = "local";
/// File with the name of the directory's audit log; a shared database keeps one anchor for each name.
const LOG_NAME: &str = "audit-log";

/// The name of the audit log in a directory; `None` when it has none.
pub(super) fn log_name(directory: &Path) -> std::io::Result<Option<String>> {
    match std::fs::read_to_string(directory.join(LOG_NAME)) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        name => name.map(Some),
    }
}

/// The name of the audit log in a directory; a directory without one gets a new name.
pub(super) fn given_log_name(directory: &Path) -> std::io::Result<String> {
    if let Some(name) = log_name(directory)? {
        return Ok(name);
    }
    let (name, file) = (uuid::Uuid::now_v7().to_string(), directory.join(LOG_NAME));
    let fresh = file.with_extension("new");
    std::fs::write(&fresh, &name)?;
    std::fs::rename(fresh, file)?;
    Ok(name)
}

/// A directory that this process has locked; the lock is held while this lives.
#[derive(Debug)]
pub(super) struct HeldDirectory {
    lock: File,
    path: PathBuf,
}

impl HeldDirectory {
    /// Whether the path still leads to the locked directory. Otherwise it was moved, deleted or made again.
    pub(super) fn is_there(&self) -> bool {
        match (self.lock.metadata(), std::fs::metadata(self.path.join(LOCK))) {
            (Ok(held), Ok(found)) => is_same_file(&held, &found),
            _ => false,
        }
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }
}

#[cfg(unix)]
fn is_same_file(a: &std::fs::Metadata, b: &std::fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

#[cfg(not(unix))]
fn is_same_file(_: &std::fs::Metadata, _: &std::fs::Metadata) -> bool {
    true
}

/// Locks the directory for this process.
pub(super) fn lock(directory: &Path) -> Result<HeldDirectory, StoreError> {
    let lock = File::create(directory.join(LOCK))?;
    match lock.try_lock() {
        Ok(()) => Ok(HeldDirectory { lock, path: directory.to_owned() }),
        Err(TryLockError::WouldBlock) => Err(StoreError::InUse),
        Err(TryLockError::Error(error)) => Err(StoreError::Io(error)),
    }
}

/// Marks a directory as one whose copy of a store is incomplete.
pub(super) fn mark_unfinished(directory: &Path) -> std::io::Result<()> {
    File::create(directory.join(UNFINISHED))?.sync_all()?;
    File::open(directory)?.sync_all()
}

pub(super) fn mark_finished(directory: &Path) -> std::io::Result<()> {
    std::fs::remove_file(directory.join(UNFINISHED))?;
    File::open(directory)?.sync_all()
}

pub(super) fn is_unfinished(directory: &Path) -> std::io::Result<bool> {
    directory.join(UNFINISHED).try_exists()
}

/// Creates the directory, accessible to its owner only.
pub(super) fn create_private(directory: &Path) -> std::io::Result<()> {
    let mut builder = std::fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(directory)
}
