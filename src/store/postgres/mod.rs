//! Rows in a Postgres database, which several processes may share.

mod dialect;
mod format;
#[path = "../sql/mod.rs"]
mod sql;

use std::time::Duration;

use sqlx::PgPool;
use sqlx::postgres::{PgConnectOptions, PgPoolOptions};

use self::PostgresMeta as Meta;
use super::StoreError;

pub(super) use format::migrate;

type Result<T> = std::result::Result<T, StoreError>;

/// Connections of one process.
const CONNECTIONS: u32 = 12;
/// Longest wait for a connection: after that the database counts as away.
const PATIENCE: Duration = Duration::from_secs(5);
/// Longest wait for a row that another transaction holds, and longest silence within a transaction: a process that has lost its way
/// does not stand in the way of others.
const LIMITS: [(&str, &str); 2] = [("lock_timeout", "20s"), ("idle_in_transaction_session_timeout", "60s")];

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
        let pool = pool.connect_with(options.clone().options(LIMITS)).await?;
        Ok(Self { pool })
    }

    fn writer(&self) -> &PgPool {
        &self.pool
    }

    fn reader(&self) -> &PgPool {
        &self.pool
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
