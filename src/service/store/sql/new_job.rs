use sqlx::AssertSqlSafe;

use super::dialect::NOW_MS;
use super::events::append;
use super::{Result, Transaction, gone_if_orphan};
use crate::JobRecord;

/// Adds the row of an accepted job with its first event.
pub(super) async fn add(transaction: &mut Transaction<'_>, job: &JobRecord, event: &str) -> Result<()> {
    let row = format!(
        "INSERT INTO jobs (id, session, tenant, kind, lane, state, phase, progress, steps, attempt, request, subject,
                           other_session, max_wall_s, warnings, bytes, created_at, traceparent, continues, waits_since)
         VALUES ($1, $2, coalesce((SELECT tenant FROM sessions WHERE id = $2), 'local'),
                 $3, $4, $5, $6, 0, $7, 0, $8, $9, $10, $11, '[]', 0, $12, $13, $14, {NOW_MS})"
    );
    sqlx::query(AssertSqlSafe(row))
        .bind(job.id.to_string())
        .bind(job.session.to_string())
        .bind(job.kind.as_str())
        .bind(job.kind.lane().as_str())
        .bind(job.state.as_str())
        .bind(&job.phase)
        .bind(i64::from(job.steps))
        .bind(&job.request)
        .bind(&job.subject)
        .bind(job.other_session.map(|s| s.to_string()))
        .bind(job.max_wall_s)
        .bind(&job.created_at)
        .bind(&job.traceparent)
        .bind(job.continues.map(|j| j.to_string()))
        .execute(&mut **transaction)
        .await
        .map_err(gone_if_orphan)?;
    append(transaction, job.id, "status", event).await
}
