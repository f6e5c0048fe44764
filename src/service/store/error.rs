use std::path::PathBuf;

use sqlx::error::DatabaseError;

/// Why the store could not do what was requested.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The database answered a statement with an error.
    #[error("the database failed")]
    Database(#[source] sqlx::Error),
    /// The database did not answer, or takes no writes now.
    ///
    /// The outcome of the current write is unknown: it may have been committed.
    #[error("the database cannot be reached or written")]
    Unreachable(#[source] sqlx::Error),
    /// The bucket did not answer, or answered only with server errors, until the retries ended.
    #[error("the bucket cannot be reached")]
    BucketUnreachable(#[source] object_store::Error),
    /// The bucket refuses every request of this process.
    ///
    /// It does not exist, the access key is wrong or lacks a permission, or the clock of this machine is wrong.
    #[error("the bucket refuses this process")]
    BucketDenied(#[source] object_store::Error),
    /// The configuration of the object store is not valid.
    #[error("the bucket cannot be used")]
    Bucket(#[source] object_store::Error),
    /// The bucket or directory of the blobs belongs to another database, whose blobs a sweep would remove.
    #[error(
        "{place} and the database do not belong together: {detail}; name a matching pair, or an empty database with an empty bucket or prefix"
    )]
    ForeignBlobs {
        /// Bucket or directory.
        place: String,
        /// What does not match.
        detail: &'static str,
    },
    /// Reading or writing a blob failed.
    #[error("the blob store failed")]
    Blob(#[source] object_store::Error),
    /// The blob was removed after its name was read, because its row was replaced or deleted meanwhile.
    #[error("the blob {key} was removed")]
    BlobGone {
        /// Its key.
        key: String,
    },
    /// A blob does not match its seal: its bytes were changed or cut off.
    #[error("the stored value {key} is damaged: its bytes were changed or cut off")]
    Damaged {
        /// Its key.
        key: String,
    },
    /// Values are encrypted with a key that is not among those given.
    #[error(
        "its values are encrypted with the key {id}, which is not among the keys given: add it to `encryption.keys` or to the \
         file that `encryption.key_file` names"
    )]
    KeyUnknown {
        /// Id of the key, hexadecimal.
        id: String,
    },
    /// A file of the data directory cannot be read or written.
    #[error("its files cannot be read or written")]
    Io(#[from] std::io::Error),
    /// A row or the content of a blob cannot be decoded.
    #[error("a stored record cannot be read: {detail}")]
    Record {
        /// Which record, and why.
        detail: String,
    },
    /// A later version of the program wrote the store.
    #[error(
        "it has format {found}, this version reads formats up to {known}; run the version that wrote it, or name another store"
    )]
    Newer {
        /// Version found.
        found: i64,
        /// Newest version that is known.
        known: i64,
    },
    /// An earlier version wrote the store, and this call does not migrate it.
    #[error("it has format {found}, this version needs format {known}; start the service once to migrate it")]
    Older {
        /// Version found.
        found: i64,
        /// Version of this program.
        known: i64,
    },
    /// The database file is another program's, or has a format that was never released.
    #[error(
        "its database is not of this version's format; name another directory, or, when nothing in it is needed, \
         delete prosopon.sqlite and blobs in it"
    )]
    Foreign,
    /// The database has tables of another program, or tables that were changed by hand.
    #[error(
        "the database has tables that no version of this program made; name a database that only this program uses"
    )]
    ForeignTables,
    /// A backup or a restore into the directory was interrupted.
    #[error(
        "a backup or a restore into it was interrupted, so part of its content is missing; repeat the restore, or delete \
         the directory and repeat the backup"
    )]
    Unfinished,
    /// A path in the data directory does not lead to what was opened there.
    #[error("{} was moved, deleted, replaced or made inaccessible while the service used it", path.display())]
    DirectoryGone {
        /// The path.
        path: PathBuf,
    },
    /// The disk has less room than the store keeps free.
    #[error("the disk has {} MB left, and {} MB are kept for deletions", bytes >> 20, least >> 20)]
    NoRoom {
        /// Bytes that are left.
        bytes: u64,
        /// Bytes that are kept free.
        least: u64,
    },
    /// Another process has the data directory open.
    #[error("another process is using it")]
    InUse,
    /// The session of the row was deleted meanwhile, or the job does not run under this fence any more.
    #[error("the session was deleted meanwhile")]
    SessionGone,
    /// Another request used the idempotency key meanwhile.
    #[error("the idempotency key was used meanwhile")]
    KeyTaken,
    /// The write would take the session above its quota.
    #[error("the session would exceed its quota of {allowed} bytes")]
    QuotaFull {
        /// Bytes allowed.
        allowed: u64,
    },
    /// The directory has no local database with local blobs.
    #[error(
        "there is no store with a local database and local files in {directory}; the service itself checks values in a bucket"
    )]
    Missing {
        /// The directory that was searched.
        directory: String,
    },
    /// A backup cannot be made or restored.
    #[error("the backup is not usable: {detail}")]
    Backup {
        /// What is wrong.
        detail: String,
    },
    /// The upload is longer than allowed.
    #[error("the upload is longer than {allowed} bytes")]
    TooLarge {
        /// Bytes allowed.
        allowed: u64,
    },
}

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        if is_unreachable(&error) { Self::Unreachable(error) } else { Self::Database(error) }
    }
}

/// Whether the same statement may succeed later.
///
/// True when the database cannot be reached, starts or stops, lacks connections or memory, does not let this user in, or is a
/// read-only replica; also when it ended a statement because of a lock timeout, a deadlock or a cancellation.
fn is_unreachable(error: &sqlx::Error) -> bool {
    const CLASSES: [&str; 3] = ["08", "28", "57P"];
    const CODES: [&str; 10] =
        ["53200", "53300", "53400", "25006", "25P03", "3D000", "40P01", "42501", "55P03", "57014"];
    let broken = matches!(
        error,
        sqlx::Error::Io(_)
            | sqlx::Error::Tls(_)
            | sqlx::Error::Protocol(_)
            | sqlx::Error::PoolTimedOut
            | sqlx::Error::PoolClosed
            | sqlx::Error::WorkerCrashed
    );
    let code = error.as_database_error().and_then(DatabaseError::code);
    let reported = |code: &str| CLASSES.iter().any(|class| code.starts_with(class)) || CODES.contains(&code);
    broken || code.is_some_and(|code| reported(&code))
}

impl From<object_store::Error> for StoreError {
    fn from(error: object_store::Error) -> Self {
        use object_store::Error::{Generic, NotFound, PermissionDenied, Unauthenticated};
        if let NotFound { path: key, .. } = error {
            return Self::BlobGone { key };
        }
        // object_store has kinds of their own for refused requests; other S3 errors are `Generic`.
        let reported = matches!(error, PermissionDenied { .. } | Unauthenticated { .. });
        let answered = matches!(error, Generic { store: "S3", .. });
        if reported || (answered && chain_has(&error, "NoSuchBucket")) {
            Self::BucketDenied(error)
        } else if answered {
            Self::BucketUnreachable(error)
        } else {
            Self::Blob(error)
        }
    }
}

/// Whether the text of an error or of one of its sources contains `word`.
fn chain_has(error: &dyn std::error::Error, word: &str) -> bool {
    std::iter::successors(Some(error), |error| error.source()).any(|error| error.to_string().contains(word))
}

impl StoreError {
    pub(super) fn record(detail: impl Into<String>) -> Self {
        Self::Record { detail: detail.into() }
    }

    /// Whether the same call may succeed later, when the database or the bucket can be reached again.
    #[must_use]
    pub fn is_unreachable(&self) -> bool {
        matches!(self, Self::Unreachable(_) | Self::BucketUnreachable(_))
    }

    /// Whether the write may have been committed although its answer was lost.
    ///
    /// The blobs that it names must then stay; a later sweep removes them if no row names them.
    pub(super) fn may_be_written(&self) -> bool {
        matches!(self, Self::Unreachable(_))
    }

    /// Whether the disk is full.
    #[must_use]
    pub fn is_disk_full(&self) -> bool {
        let mut source: Option<&(dyn std::error::Error + 'static)> = Some(self);
        while let Some(error) = source {
            if let Some(io) = error.downcast_ref::<std::io::Error>()
                && io.kind() == std::io::ErrorKind::StorageFull
            {
                return true;
            }
            source = error.source();
        }
        matches!(self, Self::Database(error) if error.as_database_error().is_some_and(is_full))
    }
}

/// SQLITE_FULL (plain or extended), or the Postgres code for a full disk.
///
/// Postgres codes have five characters.
fn is_full(error: &dyn DatabaseError) -> bool {
    let code = error.code().unwrap_or_default();
    code == "53100" || (code.len() < 5 && code.parse::<u32>().is_ok_and(|code| code & 0xff == 13))
}
