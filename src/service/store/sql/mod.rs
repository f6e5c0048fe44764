//! Rows as SQL, with one text for all databases.
//!
//! Each engine compiles this module against its driver; its module `dialect` holds what differs between the databases.
//!
//! On Postgres transactions run concurrently (SQLite has one writer). They rely on two rules:
//! - A change of a session as a whole (quota, twins of jobs) locks the session's row. A change of a job locks the job's row, and
//!   the session's row before it where it needs both. Several jobs are locked in the order of their ids, so nothing deadlocks.
//! - A transaction that waited for a lock reads the row again.

mod anchor;
mod answers;
mod contents;
mod events;
mod jobs;
mod maintenance;
mod meta;
mod new_job;
mod parts;
mod plans;
mod queue;
mod sessions;
mod steps;

use super::Meta;
use super::dialect::{self, Db};
use crate::StoreError;

type Result<T> = std::result::Result<T, StoreError>;
type Pool = sqlx::Pool<Db>;
type Transaction<'t> = sqlx::Transaction<'t, Db>;
type Connection = <Db as sqlx::Database>::Connection;
type DbRow = <Db as sqlx::Database>::Row;

/// Maps a foreign key violation to [`StoreError::SessionGone`]: the session of the row was deleted.
fn gone_if_orphan(error: sqlx::Error) -> StoreError {
    let orphan = error.as_database_error().is_some_and(sqlx::error::DatabaseError::is_foreign_key_violation);
    if orphan { StoreError::SessionGone } else { error.into() }
}
