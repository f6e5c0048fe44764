use sqlx::AssertSqlSafe;

use super::dialect::{FOR_CHANGE, LISTED};
use super::{Pool, Result, Transaction};
use crate::event::KEPT_PROGRESS;
use crate::records::{id_list, to_i64, to_u64};
use crate::{EventRecord, JobId};

pub(super) async fn append(transaction: &mut Transaction<'_>, job: JobId, kind: &str, data: &str) -> Result<()> {
    sqlx::query(
        "INSERT INTO events (job, seq, kind, data)
         VALUES ($1, (SELECT coalesce(max(seq), 0) + 1 FROM events WHERE job = $1), $2, $3)",
    )
    .bind(job.to_string())
    .bind(kind)
    .bind(data)
    .execute(&mut **transaction)
    .await?;
    Ok(())
}

pub(super) async fn append_all(
    transaction: &mut Transaction<'_>,
    job: JobId,
    events: &[(&'static str, String)],
) -> Result<()> {
    for (kind, data) in events {
        append(transaction, job, kind, data).await?;
    }
    Ok(())
}

/// Appends a progress event and deletes progress events that are not among the last events of the job.
pub(super) async fn append_progress(transaction: &mut Transaction<'_>, job: JobId, data: &str) -> Result<()> {
    append(transaction, job, "progress", data).await?;
    sqlx::query(
        "DELETE FROM events WHERE job = $1 AND kind = 'progress'
         AND seq <= (SELECT max(seq) FROM events WHERE job = $1) - $2",
    )
    .bind(job.to_string())
    .bind(to_i64(KEPT_PROGRESS))
    .execute(&mut **transaction)
    .await?;
    Ok(())
}

pub(super) async fn after(reader: &Pool, job: JobId, after: u64) -> Result<Vec<EventRecord>> {
    let rows: Vec<(i64, String, String)> =
        sqlx::query_as("SELECT seq, kind, data FROM events WHERE job = $1 AND seq > $2 ORDER BY seq")
            .bind(job.to_string())
            .bind(to_i64(after))
            .fetch_all(reader)
            .await?;
    Ok(rows.into_iter().map(|(seq, kind, data)| EventRecord { seq: to_u64(seq), kind, data }).collect())
}

pub(super) async fn prune(writer: &Pool, ended_before: &str) -> Result<u64> {
    let mut transaction = writer.begin().await?;
    let ended = format!(
        "SELECT id FROM jobs WHERE state IN ('succeeded', 'failed', 'cancelled') AND finished_at < $1
         AND events_from < (SELECT max(seq) FROM events WHERE job = jobs.id) ORDER BY id {FOR_CHANGE}"
    );
    let ended = sqlx::query_scalar(AssertSqlSafe(ended)).bind(ended_before);
    let ended: Vec<String> = ended.fetch_all(&mut *transaction).await?;
    let ended = id_list(&ended);
    let old = format!(
        "DELETE FROM events WHERE job IN {LISTED} AND seq < (SELECT max(seq) FROM events AS e WHERE e.job = events.job)"
    );
    let dropped = sqlx::query(AssertSqlSafe(old)).bind(&ended).execute(&mut *transaction).await?.rows_affected();
    let kept =
        format!("UPDATE jobs SET events_from = (SELECT max(seq) FROM events WHERE job = jobs.id) WHERE id IN {LISTED}");
    sqlx::query(AssertSqlSafe(kept)).bind(&ended).execute(&mut *transaction).await?;
    transaction.commit().await?;
    Ok(dropped)
}
