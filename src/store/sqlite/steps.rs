use std::collections::BTreeMap;

use sqlx::SqlitePool;

use super::events::append_all;
use super::{Result, sessions};
use crate::store::records::{id_list, parse_id, to_i64, to_u32, to_u64};
use crate::store::{JobId, StepRecord, StepWritten, StoreError};

type Row = (String, i64, f64, String, Option<String>, String, String, i64);

pub(super) async fn commit(
    writer: &SqlitePool,
    job: JobId,
    fence: u64,
    step: &StepRecord,
    events: &[(&'static str, String)],
    quota: u64,
) -> Result<StepWritten> {
    let mut transaction = writer.begin().await?;
    let session: Option<String> =
        sqlx::query_scalar("SELECT session FROM jobs WHERE id = ? AND state = 'running' AND fence = ?")
            .bind(job.to_string())
            .bind(to_i64(fence))
            .fetch_optional(&mut *transaction)
            .await?;
    let Some(session) = session else { return Err(StoreError::SessionGone) };
    let old: Option<(String, String)> = sqlx::query_as("SELECT blob, sha256 FROM steps WHERE job = ? AND k = ?")
        .bind(job.to_string())
        .bind(i64::from(step.k))
        .fetch_optional(&mut *transaction)
        .await?;
    if old.as_ref().is_some_and(|(_, sha256)| *sha256 == step.sha256) {
        return Ok(StepWritten::Same);
    }
    sqlx::query(
        "INSERT OR REPLACE INTO steps (job, k, t, document, error, blob, sha256, bytes)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
    )
    .bind(job.to_string())
    .bind(i64::from(step.k))
    .bind(step.t)
    .bind(&step.document)
    .bind(&step.error)
    .bind(&step.blob)
    .bind(&step.sha256)
    .bind(to_i64(step.bytes))
    .execute(&mut *transaction)
    .await?;
    append_all(&mut transaction, job, events).await?;
    sessions::check_bytes(&mut transaction, parse_id(&session)?, quota).await?;
    transaction.commit().await?;
    Ok(StepWritten::New(old.map(|(blob, _)| blob)))
}

pub(super) async fn of(reader: &SqlitePool, jobs: &[JobId]) -> Result<BTreeMap<JobId, Vec<StepRecord>>> {
    let rows: Vec<Row> = sqlx::query_as(
        "SELECT job, k, t, document, error, blob, sha256, bytes FROM steps
         WHERE job IN (SELECT value FROM json_each(?)) ORDER BY job, k",
    )
    .bind(id_list(jobs))
    .fetch_all(reader)
    .await?;
    let mut found: BTreeMap<JobId, Vec<StepRecord>> = BTreeMap::new();
    for (job, k, t, document, error, blob, sha256, bytes) in rows {
        let step = StepRecord { k: to_u32(k), t, document, error, blob, sha256, bytes: to_u64(bytes) };
        found.entry(parse_id(&job)?).or_default().push(step);
    }
    Ok(found)
}
