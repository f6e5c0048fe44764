//! The data directory of a process.

use std::fs::{File, Metadata, TryLockError};
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

/// A file or directory that must stay where it was opened.
#[derive(Debug)]
pub(super) struct Watched {
    /// Absolute, so that a move of the working directory is seen too.
    path: PathBuf,
    found: Metadata,
    /// Keeps the number of the file from being used again.
    _held: Option<File>,
}

impl Watched {
    pub(super) fn new(path: &Path, held: Option<File>) -> std::io::Result<Self> {
        Ok(Self { path: std::path::absolute(path)?, found: std::fs::metadata(path)?, _held: held })
    }

    /// # Errors
    /// [`StoreError::DirectoryGone`] when the path does not lead to what was opened.
    pub(super) fn check(&self) -> Result<(), StoreError> {
        match std::fs::metadata(&self.path) {
            Ok(now) if is_same_file(&self.found, &now) => Ok(()),
            _ => Err(StoreError::DirectoryGone { path: self.path.clone() }),
        }
    }
}

#[cfg(unix)]
fn is_same_file(a: &Metadata, b: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

#[cfg(not(unix))]
fn is_same_file(_: &Metadata, _: &Metadata) -> bool {
    true
}

/// Locks the directory for this process, as long as the result lives.
pub(super) fn lock(directory: &Path) -> Result<Watched, StoreError> {
    let path = directory.join(LOCK);
    let lock = File::create(&path)?;
    match lock.try_lock() {
        Ok(()) => Ok(Watched::new(&path, Some(lock))?),
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
