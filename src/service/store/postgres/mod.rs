//! Rows in a Postgres database, which several processes may share.

mod changes;
mod dialect;
mod format;
#[path = "../sql/mod.rs"]
mod sql;

use std::time::Duration;

use sqlx::postgres::{PgConnectOptions, PgPoolOptions};
use sqlx::{PgConnection, PgPool};

use self::PostgresMeta as Meta;
use super::{Changes, StoreError};

pub(super) use format::migrate;

type Result<T> = std::result::Result<T, StoreError>;

/// Largest number of connections of one process.
const CONNECTIONS: u32 = 12;
/// Longest wait for a connection; after it the database counts as unreachable.
const PATIENCE: Duration = Duration::from_secs(5);
/// Longest wait for a lock, and longest pause within a transaction.
///
/// They keep a process that hangs from blocking others.
const LIMITS: [(&str, &str); 2] = [("lock_timeout", "20s"), ("idle_in_transaction_session_timeout", "5s")];

/// A Postgres database that other processes may use at the same time.
#[derive(Debug)]
pub(super) struct PostgresMeta {
    /// Tests each connection before its use, so that a broken one is replaced.
    pool: PgPool,
}

impl PostgresMeta {
    /// Opens the database and migrates it to the current format.
    pub(super) async fn open(options: &PgConnectOptions) -> Result<Self> {
        migrate(options).await?;
        Self::connect(options).await
    }

    /// Opens a database of the current format without migrating it.
    pub(super) async fn open_beside(options: &PgConnectOptions) -> Result<Self> {
        format::check_version(options).await?;
        Self::connect(options).await
    }

    async fn connect(options: &PgConnectOptions) -> Result<Self> {
        let pool = PgPoolOptions::new().max_connections(CONNECTIONS).acquire_timeout(PATIENCE);
        let pool = pool.after_release(|connection, _| Box::pin(is_free(connection)));
        let pool = pool.connect_with(options.clone().options(LIMITS)).await?;
        Ok(Self { pool })
    }

    fn writer(&self) -> &PgPool {
        &self.pool
    }

    fn reader(&self) -> &PgPool {
        &self.pool
    }

    /// Listens for notifications on a connection of its own.
    async fn listen(&self) -> Result<Option<Changes>> {
        Ok(Some(changes::changes(&self.pool).await?))
    }

    /// Checks that the database answers and takes writes; a read-only replica does not.
    async fn probe(&self) -> Result<()> {
        let mut transaction = self.pool.begin().await?;
        // FOR UPDATE takes a row lock, which a read-only server refuses.
        sqlx::query("SELECT chain FROM audit_anchors LIMIT 0 FOR UPDATE").execute(&mut *transaction).await?;
        transaction.rollback().await?;
        Ok(())
    }

    async fn close_all(&self) {
        self.pool.close().await;
    }
}

/// Whether a released connection is outside a transaction; if not, it is closed.
///
/// A cancelled call (a client leaves, a job ends while its progress is written) can leave a transaction that the driver does not
/// know of. Writes in it would stay invisible, and its locks would stay held.
async fn is_free(connection: &mut PgConnection) -> sqlx::Result<bool> {
    // The two times are equal only when the statement has its own transaction.
    let fresh = sqlx::raw_sql("SELECT now() = statement_timestamp()").fetch_one(connection).await?;
    sqlx::Row::try_get(&fresh, 0)
}
