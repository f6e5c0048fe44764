use sqlx::{AssertSqlSafe, Row};

use super::dialect::{FOR_CHANGE, LISTED};
use super::events::{append_all, append_progress};
use super::{DbRow, Pool, Result, Transaction, new_job, sessions};
use crate::job::{joined_warnings, progress_after};
use crate::records::{from_json, id_list, now_rfc3339, parse_id, to_i64, to_json, to_u32, to_u64};
use crate::{BlobInfo, JobChange, JobFilter, JobId, JobKind, JobRecord, JobState, StoreError, TenantId};

pub(super) fn record(row: &DbRow) -> Result<JobRecord> {
    let text = |name: &str| row.try_get::<String, _>(name);
    let id_in = |name: &str| row.try_get::<Option<String>, _>(name);
    Ok(JobRecord {
        number: to_u64(row.try_get("number")?),
        id: parse_id(&text("id")?)?,
        session: parse_id(&text("session")?)?,
        tenant: sessions::tenant_of(&text("tenant")?)?,
        kind: text("kind")?.parse().map_err(StoreError::record)?,
        state: text("state")?.parse().map_err(StoreError::record)?,
        phase: text("phase")?,
        progress: row.try_get("progress")?,
        steps: to_u32(row.try_get("steps")?),
        attempt: to_u32(row.try_get("attempt")?),
        fence: to_u64(row.try_get("fence")?),
        lease_until: row.try_get("lease_until")?,
        request: text("request")?,
        subject: row.try_get("subject")?,
        other_session: id_in("other_session")?.as_deref().map(parse_id).transpose()?,
        max_wall_s: row.try_get("max_wall_s")?,
        traceparent: row.try_get("traceparent")?,
        cancel_requested_at: row.try_get("cancel_requested_at")?,
        superseded_by: id_in("superseded_by")?.as_deref().map(parse_id).transpose()?,
        continues: id_in("continues")?.as_deref().map(parse_id).transpose()?,
        continued_by: id_in("continued_by")?.as_deref().map(parse_id).transpose()?,
        events_from: to_u64(row.try_get("events_from")?),
        report: row.try_get("report")?,
        fault: row.try_get("fault")?,
        warnings: from_json("warnings of a job", &text("warnings")?)?,
        rest_blob: row.try_get("rest_blob")?,
        tissue_blob: row.try_get("tissue_blob")?,
        checkpoint_blob: row.try_get("milestone_blob")?,
        created_at: text("created_at")?,
        started_at: row.try_get("started_at")?,
        finished_at: row.try_get("finished_at")?,
    })
}

pub(super) async fn one(reader: &Pool, id: JobId) -> Result<Option<JobRecord>> {
    let row = sqlx::query("SELECT * FROM jobs WHERE id = $1").bind(id.to_string()).fetch_optional(reader).await?;
    row.as_ref().map(record).transpose()
}

pub(super) async fn page(reader: &Pool, filter: &JobFilter) -> Result<Vec<JobRecord>> {
    sqlx::query(
        "SELECT * FROM jobs WHERE ($1 IS NULL OR session = $1) AND ($2 IS NULL OR state = $2)
         AND ($3 IS NULL OR id < $3) AND ($4 IS NULL OR tenant = $4) AND ($5 IS NULL OR kind = $5)
         AND NOT EXISTS (SELECT 1 FROM tombstones t WHERE t.id = jobs.id) ORDER BY id DESC LIMIT $6",
    )
    .bind(filter.session.map(|s| s.to_string()))
    .bind(filter.state.map(JobState::as_str))
    .bind(filter.before.map(|b| b.to_string()))
    .bind(filter.tenant.as_ref().map(TenantId::as_str))
    .bind(filter.kind.map(JobKind::as_str))
    .bind(i64::from(filter.limit))
    .fetch_all(reader)
    .await?
    .iter()
    .map(record)
    .collect()
}

/// Locks the row of a job until the transaction ends, and reads it.
pub(super) async fn held(transaction: &mut Transaction<'_>, id: JobId) -> Result<Option<JobRecord>> {
    let row = format!("SELECT * FROM jobs WHERE id = $1 {FOR_CHANGE}");
    let row = sqlx::query(AssertSqlSafe(row)).bind(id.to_string());
    row.fetch_optional(&mut **transaction).await?.as_ref().map(record).transpose()
}

/// Locks the row of a job and of its session, for changes of the session's stored bytes.
pub(super) async fn held_with_session(transaction: &mut Transaction<'_>, id: JobId) -> Result<Option<JobRecord>> {
    let session = format!("SELECT id FROM sessions WHERE id = (SELECT session FROM jobs WHERE id = $1) {FOR_CHANGE}");
    sqlx::query(AssertSqlSafe(session)).bind(id.to_string()).fetch_optional(&mut **transaction).await?;
    held(transaction, id).await
}

pub(super) async fn change(
    writer: &Pool,
    id: JobId,
    fence: u64,
    from: JobState,
    to: JobState,
    change: &JobChange,
    quota: u64,
) -> Result<bool> {
    let mut transaction = writer.begin().await?;
    let job = if change.tissue.is_some() || change.continuation.is_some() {
        held_with_session(&mut transaction, id).await?
    } else {
        held(&mut transaction, id).await?
    };
    let Some(job) = job.filter(|j| j.may_change(from, fence, to)) else { return Ok(false) };
    write_change(&mut transaction, &job, to, change).await?;
    if change.tissue.is_some() {
        sessions::check_bytes(&mut transaction, job.session, quota).await?;
    }
    transaction.commit().await?;
    Ok(true)
}

/// Writes a change of state with its events; `job` must be the locked row.
pub(super) async fn write_change(
    transaction: &mut Transaction<'_>,
    job: &JobRecord,
    to: JobState,
    change: &JobChange,
) -> Result<()> {
    let warnings = joined_warnings(job.warnings.clone(), &change.warnings);
    sqlx::query(
        "UPDATE jobs SET state = $2, phase = coalesce($3, phase), attempt = attempt + $4,
         report = coalesce($5, report), fault = coalesce($6, fault),
         tissue_blob = coalesce($7, tissue_blob), bytes = bytes + $8, progress = $9, warnings = $10,
         started_at = CASE WHEN $11 THEN $12 ELSE started_at END,
         finished_at = CASE WHEN $13 THEN $12 ELSE finished_at END,
         milestone_blob = CASE WHEN $13 THEN NULL ELSE milestone_blob END
         WHERE id = $1",
    )
    .bind(job.id.to_string())
    .bind(to.as_str())
    .bind(change.phase)
    .bind(change.attempt_change)
    .bind(&change.report)
    .bind(&change.fault)
    .bind(change.tissue.as_ref().map(|t| t.key.clone()))
    .bind(change.tissue.as_ref().map_or(0, |t| to_i64(t.bytes)))
    .bind(progress_after(to, change.progress, job.progress))
    .bind(to_json("warnings of a job", &warnings)?)
    .bind(to == JobState::Running)
    .bind(now_rfc3339())
    .bind(to.has_ended())
    .execute(&mut **transaction)
    .await?;
    append_all(transaction, job.id, &change.events).await?;
    let Some((next, event)) = change.continuation.as_deref() else { return Ok(()) };
    new_job::add(transaction, next, event).await?;
    let named = sqlx::query("UPDATE jobs SET continued_by = $1 WHERE id = $2").bind(next.id.to_string());
    named.bind(job.id.to_string()).execute(&mut **transaction).await?;
    Ok(())
}

pub(super) async fn request_cancel(writer: &Pool, id: JobId) -> Result<bool> {
    let changed = sqlx::query(
        "UPDATE jobs SET cancel_requested_at = coalesce(cancel_requested_at, $2)
         WHERE id = $1 AND state NOT IN ('succeeded', 'failed', 'cancelled')",
    )
    .bind(id.to_string())
    .bind(now_rfc3339())
    .execute(writer)
    .await?;
    Ok(changed.rows_affected() > 0)
}

pub(super) async fn record_progress(
    writer: &Pool,
    id: JobId,
    fence: u64,
    phase: &str,
    progress: f64,
    event: &str,
) -> Result<bool> {
    let mut transaction = writer.begin().await?;
    let changed =
        sqlx::query("UPDATE jobs SET phase = $1, progress = $2 WHERE id = $3 AND state = 'running' AND fence = $4")
            .bind(phase)
            .bind(progress)
            .bind(id.to_string())
            .bind(to_i64(fence))
            .execute(&mut *transaction)
            .await?;
    if changed.rows_affected() == 0 {
        return Ok(false);
    }
    append_progress(&mut transaction, id, event).await?;
    transaction.commit().await?;
    Ok(true)
}

pub(super) async fn set_rest(
    writer: &Pool,
    id: JobId,
    fence: u64,
    rest: &BlobInfo,
    quota: u64,
) -> Result<Option<String>> {
    let mut transaction = writer.begin().await?;
    let running = |j: &JobRecord| j.state == JobState::Running && j.fence == fence;
    let job = held_with_session(&mut transaction, id).await?.filter(running).ok_or(StoreError::SessionGone)?;
    sqlx::query("UPDATE jobs SET rest_blob = $1, bytes = $2 WHERE id = $3")
        .bind(&rest.key)
        .bind(to_i64(rest.bytes))
        .bind(id.to_string())
        .execute(&mut *transaction)
        .await?;
    sessions::check_bytes(&mut transaction, job.session, quota).await?;
    transaction.commit().await?;
    // A repeated call finds its own key; that blob stays.
    Ok(job.rest_blob.filter(|old| *old != rest.key))
}

pub(super) async fn set_checkpoint(writer: &Pool, id: JobId, fence: u64, blob: &str) -> Result<Option<String>> {
    let mut transaction = writer.begin().await?;
    let running = |j: &JobRecord| j.state == JobState::Running && j.fence == fence;
    let job = held(&mut transaction, id).await?.filter(running).ok_or(StoreError::SessionGone)?;
    let named = sqlx::query("UPDATE jobs SET milestone_blob = $1 WHERE id = $2").bind(blob).bind(id.to_string());
    named.execute(&mut *transaction).await?;
    transaction.commit().await?;
    Ok(job.checkpoint_blob)
}

pub(super) async fn drop_comparisons(writer: &Pool, ended_before: &str) -> Result<Vec<String>> {
    let mut transaction = writer.begin().await?;
    let old = format!(
        "SELECT id, rest_blob, tissue_blob FROM jobs WHERE kind = 'compare' AND finished_at < $1
         AND (rest_blob IS NOT NULL OR tissue_blob IS NOT NULL) ORDER BY id {FOR_CHANGE}"
    );
    let old = sqlx::query_as(AssertSqlSafe(old)).bind(ended_before);
    let old: Vec<(String, Option<String>, Option<String>)> = old.fetch_all(&mut *transaction).await?;
    let ids: Vec<&String> = old.iter().map(|(id, ..)| id).collect();
    let forget = format!("UPDATE jobs SET rest_blob = NULL, tissue_blob = NULL, bytes = 0 WHERE id IN {LISTED}");
    sqlx::query(AssertSqlSafe(forget)).bind(id_list(&ids)).execute(&mut *transaction).await?;
    transaction.commit().await?;
    Ok(old.into_iter().flat_map(|(_, rest, values)| [rest, values]).flatten().collect())
}
