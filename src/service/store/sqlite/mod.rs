//! Rows in one SQLite database with a write-ahead log; every commit is synced to disk.

mod dialect;
mod format;
#[path = "../sql/mod.rs"]
mod sql;

use std::path::Path;
use std::time::Duration;

use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{Connection, SqlitePool};

pub(super) use format::DATABASE;

use self::SqliteMeta as Meta;
use super::{Changes, StoreError};

type Result<T> = std::result::Result<T, StoreError>;

/// Number of read connections beside the one writer.
const READERS: u32 = 4;

/// The SQLite database of one data directory.
#[derive(Debug)]
pub(super) struct SqliteMeta {
    /// One connection: SQLite has one writer, so callers queue here and never find the database busy.
    writer: SqlitePool,
    reader: SqlitePool,
}

impl SqliteMeta {
    /// Opens or creates the database in `directory` and migrates it to the current format.
    pub(super) async fn open(directory: &Path) -> Result<Self> {
        let options = options(directory).create_if_missing(true);
        let writer = one_writer().connect_with(options.clone()).await.map_err(format::no_database)?;
        format::prepare(&writer).await?;
        // A connection to a file does not break while it is idle, and a test before each use would double the time of a read.
        let readers = SqlitePoolOptions::new().max_connections(READERS).test_before_acquire(false);
        let reader = readers.connect_with(options).await?;
        Ok(Self { writer, reader })
    }

    /// Opens a database of the current format while another process may serve it.
    pub(super) async fn open_beside(directory: &Path) -> Result<Self> {
        let pool = one_writer().connect_with(options(directory)).await.map_err(format::no_database)?;
        format::check_version(&pool).await?;
        Ok(Self { writer: pool.clone(), reader: pool })
    }

    /// Writes a copy of the database at one moment to `file`, which must not exist.
    pub(super) async fn copy_to(&self, file: &Path) -> Result<()> {
        let file = file.to_str().ok_or_else(|| StoreError::record("the path of the copy is not UTF-8"))?;
        sqlx::query("VACUUM INTO ?").bind(file).execute(&self.reader).await?;
        Ok(())
    }

    /// Deletes the stored end of an audit log that is in another directory.
    pub(super) async fn clear_audit_anchor(&self) -> Result<()> {
        sqlx::query("DELETE FROM audit_anchors").execute(&self.writer).await?;
        Ok(())
    }

    fn reader(&self) -> &SqlitePool {
        &self.reader
    }

    /// `None`: one process has the directory open, so no other process changes rows.
    async fn listen(&self) -> Result<Option<Changes>> {
        Ok(None)
    }

    /// Checks that the database answers and takes writes.
    async fn probe(&self) -> Result<()> {
        sqlx::query("SELECT 1").execute(&self.reader).await?;
        let transaction = self.writer.begin().await?;
        transaction.rollback().await?;
        Ok(())
    }

    async fn close_all(&self) {
        self.reader.close().await;
        self.writer.close().await;
    }

    pub(super) fn writer(&self) -> &SqlitePool {
        &self.writer
    }
}

/// The pool of the write connection. A connection that is released within a transaction is closed.
///
/// On a full disk SQLite may roll back by itself, and the driver does not learn of it. Later commits would then lie in a
/// transaction that never ends.
fn one_writer() -> SqlitePoolOptions {
    SqlitePoolOptions::new().max_connections(1).after_release(|connection, _| {
        Box::pin(async move {
            // The ping completes a rollback that is still running.
            connection.ping().await?;
            Ok(!connection.is_in_transaction())
        })
    })
}

fn options(directory: &Path) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(directory.join(DATABASE))
        .journal_mode(SqliteJournalMode::Wal)
        .synchronous(SqliteSynchronous::Full)
        .foreign_keys(true)
        // Deleted rows are overwritten, because rows hold paths and reports of patients.
        .pragma("secure_delete", "ON")
        .busy_timeout(Duration::from_secs(10))
}

/// Removes the database files of a directory.
pub(super) fn remove(directory: &Path) -> Result<()> {
    for suffix in ["", "-wal", "-shm"] {
        match std::fs::remove_file(directory.join(format!("{DATABASE}{suffix}"))) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error.into()),
            _ => {}
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MetaStore;
    use crate::conformance::session;

    #[tokio::test]
    async fn the_files_forget_a_deleted_session() {
        let directory = tempfile::tempdir().unwrap();
        let meta = SqliteMeta::open(directory.path()).await.unwrap();
        let forgotten = crate::SessionRecord { label: Some("confidential".to_owned()), ..session("a") };
        let holds_label = || {
            let paths = std::fs::read_dir(directory.path()).unwrap().map(|entry| entry.unwrap().path());
            let mut files = paths.map(|path| std::fs::read(path).unwrap());
            files.any(|bytes| bytes.windows(12).any(|word| word == b"confidential"))
        };
        meta.insert_session(&forgotten, None).await.unwrap();
        assert!(holds_label());
        meta.delete_session(forgotten.id).await.unwrap();
        assert!(!holds_label());
    }

    #[tokio::test]
    async fn a_connection_that_met_a_full_disk_is_not_used_again() {
        let directory = tempfile::tempdir().unwrap();
        let meta = SqliteMeta::open(directory.path()).await.unwrap();
        let kept = session("a");
        meta.insert_session(&kept, None).await.unwrap();
        sqlx::query("PRAGMA max_page_count = 1").execute(&meta.writer).await.unwrap();
        let mut refused = 0;
        for _ in 0..400 {
            let tried = session("a");
            match meta.insert_session(&tried, None).await {
                Ok(()) => assert_eq!(meta.session(tried.id).await.unwrap(), Some(tried)),
                Err(error) => {
                    assert!(error.is_disk_full(), "{error:?}");
                    assert_eq!(meta.session(tried.id).await.unwrap(), None);
                    refused += 1;
                }
            }
        }
        // The page limit belongs to the connection, so the next connection works again.
        assert_eq!(refused, 1);
        assert_eq!(meta.session(kept.id).await.unwrap(), Some(kept));
    }
}
