use sqlx::error::DatabaseError;

/// Why the store could not do what it was asked.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// What the database says to a query.
    #[error("the database failed")]
    Database(#[source] sqlx::Error),
    /// The database did not answer, or does not take writes now; whether what was being written is there, is not known.
    #[error("the database cannot be reached or written")]
    Unreachable(#[source] sqlx::Error),
    /// The bucket did not answer, or with errors of its own, for as long as it was asked.
    #[error("the bucket cannot be reached")]
    BucketAway(#[source] object_store::Error),
    /// The bucket lets this process do nothing: it is not there, or a key was changed or may not do this, or a clock is wrong.
    #[error("the bucket refuses this process")]
    BucketRefused(#[source] object_store::Error),
    /// The object store, as it is configured.
    #[error("the bucket cannot be used")]
    Bucket(#[source] object_store::Error),
    /// The place of the blobs belongs to other rows: what these do not name would be removed from it.
    #[error(
        "{place} and the database do not belong together: {detail}; name those that do, or an empty bucket or prefix with an empty database"
    )]
    ForeignBlobs {
        /// Bucket or directory.
        place: String,
        /// How that shows.
        detail: &'static str,
    },
    /// A file of results or inputs.
    #[error("the blob store failed")]
    Blob(#[source] object_store::Error),
    /// A file was removed after its name was read: what it held was replaced or deleted meanwhile.
    #[error("the blob {key} is not there any more")]
    BlobGone {
        /// Where it was.
        key: String,
    },
    /// A stored value is not what was written.
    #[error("the stored value {key} is damaged")]
    Damaged {
        /// Where it is.
        key: String,
    },
    /// The data directory.
    #[error("its files cannot be read or written")]
    Io(#[from] std::io::Error),
    /// A stored document is not what was written.
    #[error("a stored record cannot be read: {detail}")]
    Record {
        /// Which, and why.
        detail: String,
    },
    /// Written by a later version.
    #[error(
        "it has format {found}, this version reads up to {known}; run the version that wrote it, or name another store"
    )]
    Newer {
        /// Version found.
        found: i64,
        /// Newest version that is known.
        known: i64,
    },
    /// Written by an earlier version, and not brought to the present format here.
    #[error("it has format {found}, this version writes {known}; start the service once, which brings it up to date")]
    Older {
        /// Version found.
        found: i64,
        /// Version of this program.
        known: i64,
    },
    /// Of another program, or of a version whose format was never released.
    #[error(
        "its database is not of this version's format; name another directory, or, when nothing in it is needed, \
         delete prosopon.sqlite and blobs in it"
    )]
    Foreign,
    /// Tables of another program, or changed by hand.
    #[error("the database holds tables that are not of this program's versions; name a database of its own")]
    ForeignTables,
    /// Another process has it.
    #[error("another process is using it")]
    InUse,
    /// The session that the row belongs to was deleted meanwhile.
    #[error("the session was deleted meanwhile")]
    SessionGone,
    /// An idempotency key was taken meanwhile.
    #[error("the idempotency key was used meanwhile")]
    KeyTaken,
    /// The session has as much as it may.
    #[error("a session may have {allowed} bytes")]
    QuotaFull {
        /// Bytes allowed.
        allowed: u64,
    },
    /// There is no store of this kind.
    #[error(
        "there is no store with rows and values of its own in {directory}; the service reads through those that are elsewhere"
    )]
    Missing {
        /// Where one was looked for.
        directory: String,
    },
    /// A backup is not whole.
    #[error("the backup is not usable: {detail}")]
    Backup {
        /// What is wrong.
        detail: String,
    },
    /// The upload is longer than allowed.
    #[error("more than {allowed} bytes")]
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

/// Whether a database is away, starting, stopping, out of connections or memory, lets this user in no more or not yet, or is a copy that takes
/// no writes; or has given up a statement that stood still or in the way of another, which may be tried again.
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
    let told = |code: &str| CLASSES.iter().any(|class| code.starts_with(class)) || CODES.contains(&code);
    broken || code.is_some_and(|code| told(&code))
}

impl From<object_store::Error> for StoreError {
    fn from(error: object_store::Error) -> Self {
        use object_store::Error::{Generic, NotFound, PermissionDenied, Unauthenticated};
        if let NotFound { path: key, .. } = error {
            return Self::BlobGone { key };
        }
        // What is refused for a reason has a kind of its own.
        let told = matches!(error, PermissionDenied { .. } | Unauthenticated { .. });
        let answered = matches!(error, Generic { store: "S3", .. });
        if told || (answered && chain_has(&error, "NoSuchBucket")) {
            Self::BucketRefused(error)
        } else if answered {
            Self::BucketAway(error)
        } else {
            Self::Blob(error)
        }
    }
}

/// Whether an error or one of its sources says `word`.
fn chain_has(error: &dyn std::error::Error, word: &str) -> bool {
    std::iter::successors(Some(error), |error| error.source()).any(|error| error.to_string().contains(word))
}

impl StoreError {
    pub(super) fn record(detail: impl Into<String>) -> Self {
        Self::Record { detail: detail.into() }
    }

    /// Whether the same may succeed later.
    #[must_use]
    pub fn is_away(&self) -> bool {
        matches!(self, Self::Unreachable(_) | Self::BucketAway(_))
    }

    /// Whether the rows may say what was to be written: then the blobs that they would name stay, and go with the next sweep if not.
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

/// SQLITE_FULL, in its plain or an extended form, or what Postgres says, whose codes have five characters.
fn is_full(error: &dyn DatabaseError) -> bool {
    let code = error.code().unwrap_or_default();
    code == "53100" || (code.len() < 5 && code.parse::<u32>().is_ok_and(|code| code & 0xff == 13))
}
