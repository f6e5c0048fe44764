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

/// Connections of one process.
const CONNECTIONS: u32 = 12;
/// Longest wait for a connection: after that the database counts as away.
const PATIENCE: Duration = Duration::from_secs(5);
/// Longest wait for a row that another transaction holds, and longest silence within a transaction: a process that has lost its way
/// does not stand in the way of others.
const LIMITS: [(&str, &str); 2] = [("lock_timeout", "20s"), ("idle_in_transaction_session_timeout", "5s")];

/// A database that others may use too.
#[derive(Debug)]
pub(super) struct PostgresMeta {
    /// A connection is asked before it is used, so that one that broke meanwhile is replaced.
    pool: PgPool,
}

impl PostgresMeta {
    /// Opens the database and brings it to the present format.
    pub(super) async fn open(options: &PgConnectOptions) -> Result<Self> {
        migrate(options).await?;
        Self::connect(options).await
    }

    /// Opens a database of the present format as it is.
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

    /// Takes a connection for itself.
    async fn listen(&self) -> Result<Option<Changes>> {
        Ok(Some(changes::changes(&self.pool).await?))
    }

    /// Whether it answers and can be written: a copy that only follows another server cannot.
    async fn probe(&self) -> Result<()> {
        let mut transaction = self.pool.begin().await?;
        // Takes a row lock, which a server that takes no writes refuses.
        sqlx::query("SELECT chain FROM audit_anchors LIMIT 0 FOR UPDATE").execute(&mut *transaction).await?;
        transaction.rollback().await?;
        Ok(())
    }

    async fn close_all(&self) {
        self.pool.close().await;
    }
}

/// Whether a connection that is given back is in no transaction; if not it is closed. A call that is broken off (a client leaves, a job
/// ends while its progress is being written) can leave one that the driver does not know of: what is written in it would be seen by
/// nobody, and its locks would stay.
async fn is_free(connection: &mut PgConnection) -> sqlx::Result<bool> {
    // In a simple query outside of a transaction the two are the same moment.
    let fresh = sqlx::raw_sql("SELECT now() = statement_timestamp()").fetch_one(connection).await?;
    sqlx::Row::try_get(&fresh, 0)
}
