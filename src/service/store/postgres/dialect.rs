//! What Postgres says in its own words.

use crate::StoreError;

pub(super) type Db = sqlx::Postgres;

/// Ends a query whose rows nobody else changes until the transaction ends.
pub(super) const FOR_CHANGE: &str = "FOR NO KEY UPDATE";
/// The same, and nothing new refers to them.
pub(super) const FOR_REMOVAL: &str = "FOR UPDATE";
/// Ends a query for the first job (`j`) that no one else takes at this moment.
pub(super) const FOR_CLAIM: &str = "FOR UPDATE OF j SKIP LOCKED";
/// Begins a transaction whose queries all see the same moment.
pub(super) const SNAPSHOT: &str = "BEGIN ISOLATION LEVEL REPEATABLE READ, READ ONLY";
/// The texts of the JSON list `$1`.
pub(super) const LISTED: &str = "(SELECT json_array_elements_text($1::json))";
/// A number above that of all turns before.
pub(super) const NEXT_TURN: &str = "nextval('turn')";
/// The present time, ms since 1970.
pub(super) const NOW_MS: &str = "CAST(extract(epoch FROM clock_timestamp()) * 1000 AS BIGINT)";

/// Key of the advisory lock on the length of the queue, `"queue"` in ASCII.
const QUEUE: i64 = 0x71_75_65_75_65;

/// Lets one transaction at a time count and lengthen the queue.
pub(super) async fn hold_queue(connection: &mut sqlx::PgConnection) -> Result<(), StoreError> {
    sqlx::query("SELECT pg_advisory_xact_lock($1)").bind(QUEUE).execute(connection).await?;
    Ok(())
}
