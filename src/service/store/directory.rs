//! The data directory of a process.

use std::fs::{File, TryLockError};
use std::path::Path;

use super::StoreError;

/// Directory of the large values.
pub(super) const BLOBS: &str = "blobs";
/// File whose lock says that a process has the directory.
const LOCK: &str = "lock";

/// The audit log of a store in its own directory.
pub(super) const LOCAL_LOG: &str = "local";
/// File with the name of the audit log beside it, by which a shared database tells it from others.
const LOG_NAME: &str = "audit-log";

/// The name of the audit log in a directory, where it has one.
pub(super) fn log_name(directory: &Path) -> std::io::Result<Option<String>> {
    match std::fs::read_to_string(directory.join(LOG_NAME)) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        name => name.map(Some),
    }
}

/// The name of the audit log in a directory, from now on if it had none.
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

/// Takes the directory for this process.
pub(super) fn lock(directory: &Path) -> Result<File, StoreError> {
    let lock = File::create(directory.join(LOCK))?;
    match lock.try_lock() {
        Ok(()) => Ok(lock),
        Err(TryLockError::WouldBlock) => Err(StoreError::InUse),
        Err(TryLockError::Error(error)) => Err(StoreError::Io(error)),
    }
}

/// Makes the directory, for its owner only.
pub(super) fn create_private(directory: &Path) -> std::io::Result<()> {
    let mut builder = std::fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(directory)
}
