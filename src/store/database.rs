use std::fs::{File, TryLockError};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use sqlx::SqlitePool;
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};

use super::{Blobs, StoreError};

/// Scripts that bring an empty database to the present format, one a version.
const MIGRATIONS: &[&str] = &[include_str!("schema.sql")];

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
    /// [`StoreError::InUse`] when another process has it open, [`StoreError::Newer`] when a later version wrote it,
    /// otherwise whatever the disk or the database says.
    pub async fn open(directory: &Path) -> Result<Self, StoreError> {
        create_private(directory)?;
        let lock = File::create(directory.join("lock"))?;
        lock.try_lock().map_err(|e| match e {
            TryLockError::WouldBlock => StoreError::InUse,
            TryLockError::Error(e) => StoreError::Io(e),
        })?;
        let options = SqliteConnectOptions::new()
            .filename(directory.join("prosopon.sqlite"))
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .foreign_keys(true)
            // What is deleted is overwritten: rows hold paths and reports of patients.
            .pragma("secure_delete", "ON")
            .busy_timeout(Duration::from_secs(10));
        let writer = SqlitePoolOptions::new().max_connections(1).connect_with(options.clone()).await?;
        migrate(&writer).await?;
        let reader = SqlitePoolOptions::new().max_connections(4).connect_with(options).await?;
        let blobs = Blobs::open(&directory.join("blobs"))?;
        let store = Self { writer, reader, blobs, _lock: Arc::new(lock) };
        let swept = store.blobs.sweep(&store.named_blobs().await?).await?;
        if swept > 0 {
            tracing::info!(files = swept, "removed files that no record names");
        }
        Ok(store)
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

/// Makes the directory, for its owner only.
fn create_private(directory: &Path) -> std::io::Result<()> {
    let mut builder = std::fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(directory)
}

async fn migrate(writer: &SqlitePool) -> Result<(), StoreError> {
    let found: i64 = sqlx::query_scalar("PRAGMA user_version").fetch_one(writer).await?;
    let known = MIGRATIONS.len() as i64;
    if found > known {
        return Err(StoreError::Newer { found, known });
    }
    for (index, script) in MIGRATIONS.iter().enumerate().skip(found.max(0) as usize) {
        let mut transaction = writer.begin().await?;
        sqlx::raw_sql(*script).execute(&mut *transaction).await?;
        // PRAGMA takes no bound value; the number is ours.
        let set_version = format!("PRAGMA user_version = {}", index + 1);
        sqlx::raw_sql(sqlx::AssertSqlSafe(set_version)).execute(&mut *transaction).await?;
        transaction.commit().await?;
    }
    Ok(())
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
}
