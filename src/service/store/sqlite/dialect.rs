//! What SQLite says in its own words: it has one writer, so rows need no locks.

use crate::StoreError;

pub(super) type Db = sqlx::Sqlite;

/// Ends a query whose rows nobody else changes until the transaction ends.
pub(super) const FOR_CHANGE: &str = "";
/// The same, and nothing new refers to them.
pub(super) const FOR_REMOVAL: &str = "";
/// Ends a query for the first job (`j`) that no one else takes at this moment.
pub(super) const FOR_CLAIM: &str = "";
/// Begins a transaction whose queries all see the same moment.
pub(super) const SNAPSHOT: &str = "BEGIN";
/// The texts of the JSON list `$1`.
pub(super) const LISTED: &str = "(SELECT value FROM json_each($1))";
/// A number above that of all turns before.
pub(super) const NEXT_TURN: &str = "(SELECT coalesce(max(last), 0) + 1 FROM turns)";
/// The present time, ms since 1970.
pub(super) const NOW_MS: &str = "CAST(unixepoch('subsec') * 1000 AS INTEGER)";

/// Lets one transaction at a time count and lengthen the queue.
pub(super) async fn hold_queue(_: &mut sqlx::SqliteConnection) -> Result<(), StoreError> {
    Ok(())
}
