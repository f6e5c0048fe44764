//! Rows as SQL, one text for all databases: each engine compiles this module against its driver, and its `dialect` says what the
//! databases do not have in common.
//!
//! Transactions may run side by side (on Postgres; SQLite has one writer). What each relies on:
//! - What changes a session as a whole (quota, twins of jobs) holds the session's row; what changes a job holds the job's row, and its
//!   session's before it where both are needed. Several jobs are held in the order of their ids. So nobody waits in a circle.
//! - A row that was waited for is read again after the wait.

mod anchor;
mod answers;
mod contents;
mod events;
mod house;
mod jobs;
mod meta;
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

/// A row whose session is gone breaks the foreign key.
fn gone_if_orphan(error: sqlx::Error) -> StoreError {
    let orphan = error.as_database_error().is_some_and(sqlx::error::DatabaseError::is_foreign_key_violation);
    if orphan { StoreError::SessionGone } else { error.into() }
}
