use std::fs::{File, TryLockError};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use sqlx::SqlitePool;
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};

use super::format::{self, BLOBS, DATABASE, LOCK};
use super::{Blobs, StoreError};

/// The embedded store of one data directory. Clones share it.
#[derive(Debug, Clone)]
pub struct Store {
    /// One connection: SQLite has one writer, so nobody meets a busy database.
    pub(super) writer: SqlitePool,
    pub(super) reader: SqlitePool,
    blobs: Blobs,
    /// Held open for its lock.
    _lock: Arc<File>,
}

impl Store {
    /// Opens or creates the store in `directory`, and sweeps files that no row names (left by a crash).
    ///
    /// # Errors
    /// [`StoreError::InUse`] when another process has it open, [`StoreError::Newer`] and [`StoreError::Foreign`] when another
    /// version or program wrote it, otherwise whatever the disk or the database says.
    pub async fn open(directory: &Path) -> Result<Self, StoreError> {
        create_private(directory)?;
        let lock = lock(directory)?;
        let options = SqliteConnectOptions::new()
            .filename(directory.join(DATABASE))
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .foreign_keys(true)
            // What is deleted is overwritten: rows hold paths and reports of patients.
            .pragma("secure_delete", "ON")
            .busy_timeout(Duration::from_secs(10));
        let writer = SqlitePoolOptions::new().max_connections(1).connect_with(options.clone()).await;
        let writer = writer.map_err(format::no_database)?;
        format::prepare(&writer).await?;
        let reader = SqlitePoolOptions::new().max_connections(4).connect_with(options).await?;
        let blobs = Blobs::open(&directory.join(BLOBS))?;
        let store = Self { writer, reader, blobs, _lock: Arc::new(lock) };
        let swept = store.blobs.sweep(&store.named_blobs().await?).await?;
        if swept > 0 {
            tracing::info!(files = swept, "removed files that no record names");
        }
        Ok(store)
    }

    /// Removes what a store left in `directory`, of whatever version; other files stay.
    ///
    /// # Errors
    /// [`StoreError::InUse`] when a process has it open, [`StoreError::Io`].
    pub fn erase(directory: &Path) -> Result<(), StoreError> {
        create_private(directory)?;
        let _held = lock(directory)?;
        format::remove(directory)
    }

    /// Large immutable values.
    #[must_use]
    pub fn blobs(&self) -> &Blobs {
        &self.blobs
    }

    /// Whether the database answers and can be written.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn check(&self) -> Result<(), StoreError> {
        sqlx::query("SELECT 1").execute(&self.reader).await?;
        let transaction = self.writer.begin().await?;
        transaction.rollback().await?;
        Ok(())
    }

    /// Closes all connections after what is under way.
    pub async fn close(&self) {
        self.reader.close().await;
        self.writer.close().await;
    }
}

fn lock(directory: &Path) -> Result<File, StoreError> {
    let lock = File::create(directory.join(LOCK))?;
    match lock.try_lock() {
        Ok(()) => Ok(lock),
        Err(TryLockError::WouldBlock) => Err(StoreError::InUse),
        Err(TryLockError::Error(error)) => Err(StoreError::Io(error)),
    }
}

/// Makes the directory, for its owner only.
fn create_private(directory: &Path) -> std::io::Result<()> {
    let mut builder = std::fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(directory)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_directory_belongs_to_one_process_and_opens_again() {
        let directory = tempfile::tempdir().unwrap();
        let first = Store::open(directory.path()).await.unwrap();
        assert!(matches!(Store::open(directory.path()).await, Err(StoreError::InUse)));
        first.check().await.unwrap();
        first.close().await;
        drop(first);
        Store::open(directory.path()).await.unwrap().check().await.unwrap();
    }

    #[tokio::test]
    async fn a_later_format_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let store = Store::open(directory.path()).await.unwrap();
        sqlx::raw_sql("PRAGMA user_version = 99").execute(&store.writer).await.unwrap();
        store.close().await;
        drop(store);
        assert!(matches!(Store::open(directory.path()).await, Err(StoreError::Newer { found: 99, .. })));
    }

    /// A store whose tables are of an unreleased version, another program's database, and no database.
    #[tokio::test]
    async fn what_is_no_database_of_this_version_is_refused_and_can_be_erased() {
        let other_columns = "ALTER TABLE jobs RENAME COLUMN state TO status";
        let other_program = "PRAGMA user_version = 0";
        for change in [Some(other_columns), Some(other_program), None] {
            let directory = tempfile::tempdir().unwrap();
            match change {
                Some(change) => {
                    let store = Store::open(directory.path()).await.unwrap();
                    sqlx::raw_sql(change).execute(&store.writer).await.unwrap();
                    store.close().await;
                }
                None => std::fs::write(directory.path().join(DATABASE), [b'x'; 5000]).unwrap(),
            }
            let refused = Store::open(directory.path()).await;
            assert!(matches!(refused, Err(StoreError::Foreign)), "{change:?}: {refused:?}");
            std::fs::write(directory.path().join("notes.txt"), "mine").unwrap();
            Store::erase(directory.path()).unwrap();
            let store = Store::open(directory.path()).await.unwrap();
            assert!(matches!(Store::erase(directory.path()), Err(StoreError::InUse)));
            store.close().await;
            assert!(directory.path().join("notes.txt").exists());
        }
    }
}
