//! SQL that only Postgres uses.

use crate::StoreError;

pub(super) type Db = sqlx::Postgres;

/// Ends a query that locks its rows against changes until the transaction ends.
pub(super) const FOR_CHANGE: &str = "FOR NO KEY UPDATE";
/// Ends a query that also locks its rows against new references to them.
pub(super) const FOR_REMOVAL: &str = "FOR UPDATE";
/// Ends a query for a job that leaves one out which another claim has locked.
pub(super) const FOR_CLAIM: &str = "FOR UPDATE SKIP LOCKED";
/// Tables to look for a claim in, before all jobs: the first 16 of each tenant in lane `$1`, found by the index `jobs_in_line`.
///
/// Only where all of these are taken, or left to other workers, does a claim look at all that wait.
pub(super) const HEADS_OF_LINES: &[&str] = &["(WITH RECURSIVE tenants AS (
        (SELECT n.tenant FROM jobs n WHERE n.state = 'accepted' AND n.cancel_requested_at IS NULL AND n.lane = $1
         ORDER BY n.tenant LIMIT 1)
        UNION ALL
        SELECT (SELECT n.tenant FROM jobs n WHERE n.state = 'accepted' AND n.cancel_requested_at IS NULL AND n.lane = $1
                AND n.tenant > t.tenant ORDER BY n.tenant LIMIT 1) FROM tenants t WHERE t.tenant IS NOT NULL)
    SELECT h.* FROM tenants t CROSS JOIN LATERAL (
        SELECT n.* FROM jobs n WHERE n.state = 'accepted' AND n.cancel_requested_at IS NULL AND n.lane = $1
        AND n.tenant = t.tenant ORDER BY n.number LIMIT 16) AS h)"];
/// Begins a read transaction on one snapshot.
pub(super) const SNAPSHOT: &str = "BEGIN ISOLATION LEVEL REPEATABLE READ, READ ONLY";
/// The strings of the JSON list `$1`.
pub(super) const LISTED: &str = "(SELECT json_array_elements_text($1::json))";
/// A number larger than that of every earlier turn.
pub(super) const NEXT_TURN: &str = "nextval('turn')";
/// The log of the server is its operator's.
pub(super) const FORGET: Option<&str> = None;
/// The current time, ms since 1970.
pub(super) const NOW_MS: &str = "CAST(extract(epoch FROM clock_timestamp()) * 1000 AS BIGINT)";

/// Key of the advisory lock on the queue: `"queue"` in ASCII.
const QUEUE: i64 = 0x71_75_65_75_65;

/// Locks the queue, so that one transaction at a time counts and extends it.
pub(super) async fn hold_queue(connection: &mut sqlx::PgConnection) -> Result<(), StoreError> {
    sqlx::query("SELECT pg_advisory_xact_lock($1)").bind(QUEUE).execute(connection).await?;
    Ok(())
}
