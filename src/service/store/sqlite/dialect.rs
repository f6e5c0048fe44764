//! SQL that only SQLite uses. SQLite has one writer, so rows need no locks.

use crate::StoreError;

pub(super) type Db = sqlx::Sqlite;

/// Ends a query that locks its rows against changes until the transaction ends.
pub(super) const FOR_CHANGE: &str = "";
/// Ends a query that also locks its rows against new references to them.
pub(super) const FOR_REMOVAL: &str = "";
/// Ends a query for a job that leaves one out which another claim has locked.
pub(super) const FOR_CLAIM: &str = "";
/// Tables to look for a claim in, before all jobs: none, since one process has few jobs and no round trips.
pub(super) const HEADS_OF_LINES: &[&str] = &[];
/// Begins a read transaction on one snapshot.
pub(super) const SNAPSHOT: &str = "BEGIN";
/// The strings of the JSON list `$1`.
pub(super) const LISTED: &str = "(SELECT value FROM json_each($1))";
/// A number larger than that of every earlier turn.
pub(super) const NEXT_TURN: &str = "(SELECT coalesce(max(last), 0) + 1 FROM turns)";
/// Empties the write-ahead log, which still holds the values of deleted rows.
pub(super) const FORGET: Option<&str> = Some("PRAGMA wal_checkpoint(TRUNCATE)");
/// The current time, ms since 1970.
pub(super) const NOW_MS: &str = "CAST(unixepoch('subsec') * 1000 AS INTEGER)";

/// Locks the queue, so that one transaction at a time counts and extends it.
///
/// SQLite needs no lock for that.
pub(super) async fn hold_queue(_: &mut sqlx::SqliteConnection) -> Result<(), StoreError> {
    Ok(())
}
