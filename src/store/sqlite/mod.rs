//! Rows in one SQLite database: write-ahead log, every commit synced.

mod dialect;
mod format;
#[path = "../sql/mod.rs"]
mod sql;

use std::path::Path;
use std::time::Duration;

use sqlx::SqlitePool;
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};

pub(super) use format::DATABASE;

use self::SqliteMeta as Meta;
use super::StoreError;

type Result<T> = std::result::Result<T, StoreError>;

/// Readers beside the one writer.
const READERS: u32 = 4;

/// The database of one data directory.
#[derive(Debug)]
pub(super) struct SqliteMeta {
    /// One connection: SQLite has one writer, so nobody meets a busy database.
    writer: SqlitePool,
    reader: SqlitePool,
}

impl SqliteMeta {
    /// Opens or creates the database in `directory` and brings it to the present format.
    pub(super) async fn open(directory: &Path) -> Result<Self> {
        let options = options(directory).create_if_missing(true);
        let writer = SqlitePoolOptions::new().max_connections(1).connect_with(options.clone()).await;
        let writer = writer.map_err(format::no_database)?;
        format::prepare(&writer).await?;
        // A connection to a file does not break while it waits: asking it first would double the time of a read.
        let readers = SqlitePoolOptions::new().max_connections(READERS).test_before_acquire(false);
        let reader = readers.connect_with(options).await?;
        Ok(Self { writer, reader })
    }

    /// Opens a database of the present format beside the process that serves it.
    pub(super) async fn open_beside(directory: &Path) -> Result<Self> {
        let pool = SqlitePoolOptions::new().max_connections(1).connect_with(options(directory)).await;
        let pool = pool.map_err(format::no_database)?;
        format::check_version(&pool).await?;
        Ok(Self { writer: pool.clone(), reader: pool })
    }

    /// Writes a copy of the database as it is at one moment to `file`, which must not be there.
    pub(super) async fn copy_to(&self, file: &Path) -> Result<()> {
        let file = file.to_str().ok_or_else(|| StoreError::record("the path of the copy is not UTF-8"))?;
        sqlx::query("VACUUM INTO ?").bind(file).execute(&self.reader).await?;
        Ok(())
    }

    /// Forgets the end of an audit log that is elsewhere.
    pub(super) async fn clear_audit_anchor(&self) -> Result<()> {
        sqlx::query("DELETE FROM audit_anchors").execute(&self.writer).await?;
        Ok(())
    }

    fn reader(&self) -> &SqlitePool {
        &self.reader
    }

    /// Whether it answers and can be written.
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

fn options(directory: &Path) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(directory.join(DATABASE))
        .journal_mode(SqliteJournalMode::Wal)
        .synchronous(SqliteSynchronous::Full)
        .foreign_keys(true)
        // What is deleted is overwritten: rows hold paths and reports of patients.
        .pragma("secure_delete", "ON")
        .busy_timeout(Duration::from_secs(10))
}

/// Removes the database of a directory.
pub(super) fn remove(directory: &Path) -> Result<()> {
    for suffix in ["", "-wal", "-shm"] {
        match std::fs::remove_file(directory.join(format!("{DATABASE}{suffix}"))) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error.into()),
            _ => {}
        }
    }
    Ok(())
}
