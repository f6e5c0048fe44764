//! The data directory of a process.

use std::fs::{File, TryLockError};
use std::path::Path;

use super::StoreError;

/// Directory of the blobs.
pub(super) const BLOBS: &str = "blobs";
/// File that a process locks while it has the directory open.
const LOCK: &str = "lock";

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

/// Locks the directory for this process.
pub(super) fn lock(directory: &Path) -> Result<File, StoreError> {
    let lock = File::create(directory.join(LOCK))?;
    match lock.try_lock() {
        Ok(()) => Ok(lock),
        Err(TryLockError::WouldBlock) => Err(StoreError::InUse),
        Err(TryLockError::Error(error)) => Err(StoreError::Io(error)),
    }
}

/// Creates the directory, accessible to its owner only.
pub(super) fn create_private(directory: &Path) -> std::io::Result<()> {
    let mut builder = std::fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(directory)
}
