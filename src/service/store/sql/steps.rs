use std::collections::BTreeMap;

use sqlx::AssertSqlSafe;

use super::dialect::LISTED;
use super::events::append_all;
use super::{Pool, Result, jobs, sessions};
use crate::records::{id_list, parse_id, to_i64, to_u32, to_u64};
use crate::{JobId, JobRecord, JobState, StepRecord, StepWritten, StoreError};

type Row = (String, i64, f64, String, Option<String>, String, String, i64);

pub(super) async fn commit(
    writer: &Pool,
    job: JobId,
    fence: u64,
    step: &StepRecord,
    events: &[(&'static str, String)],
    quota: u64,
) -> Result<StepWritten> {
    let mut transaction = writer.begin().await?;
    let running = |j: &JobRecord| j.state == JobState::Running && j.fence == fence;
    let held = jobs::held_with_session(&mut transaction, job).await?.filter(running).ok_or(StoreError::SessionGone)?;
    let old: Option<(String, String)> = sqlx::query_as("SELECT blob, sha256 FROM steps WHERE job = $1 AND k = $2")
        .bind(job.to_string())
        .bind(i64::from(step.k))
        .fetch_optional(&mut *transaction)
        .await?;
    match &old {
        // An earlier call stored this step, and its answer was lost.
        Some((blob, _)) if *blob == step.blob => return Ok(StepWritten::New(None)),
        Some((_, sha256)) if *sha256 == step.sha256 => {
            let error = sqlx::query("UPDATE steps SET error = $1 WHERE job = $2 AND k = $3").bind(&step.error);
            error.bind(job.to_string()).bind(i64::from(step.k)).execute(&mut *transaction).await?;
            transaction.commit().await?;
            return Ok(StepWritten::Same);
        }
        _ => {}
    }
    sqlx::query(
        "INSERT INTO steps (job, k, t, document, error, blob, sha256, bytes) VALUES ($1, $2, $3, $4, $5, $6, $7, $8)
         ON CONFLICT (job, k) DO UPDATE SET t = excluded.t, document = excluded.document, error = excluded.error,
         blob = excluded.blob, sha256 = excluded.sha256, bytes = excluded.bytes",
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
    sessions::check_bytes(&mut transaction, held.session, quota).await?;
    transaction.commit().await?;
    Ok(StepWritten::New(old.map(|(blob, _)| blob)))
}

pub(super) async fn forget(writer: &Pool, id: JobId, fence: u64) -> Result<Vec<String>> {
    let mut transaction = writer.begin().await?;
    let running = |j: &JobRecord| j.state == JobState::Running && j.fence == fence;
    let job = jobs::held_with_session(&mut transaction, id).await?.filter(running).ok_or(StoreError::SessionGone)?;
    let forgotten = sqlx::query_scalar("DELETE FROM steps WHERE job = $1 RETURNING blob").bind(id.to_string());
    let mut forgotten: Vec<String> = forgotten.fetch_all(&mut *transaction).await?;
    let unnamed = sqlx::query("UPDATE jobs SET milestone_blob = NULL WHERE id = $1").bind(id.to_string());
    unnamed.execute(&mut *transaction).await?;
    transaction.commit().await?;
    forgotten.extend(job.checkpoint_blob);
    Ok(forgotten)
}

pub(super) async fn of(reader: &Pool, wanted: &[JobId]) -> Result<BTreeMap<JobId, Vec<StepRecord>>> {
    let rows = format!(
        "SELECT job, k, t, document, error, blob, sha256, bytes FROM steps WHERE job IN {LISTED} ORDER BY job, k"
    );
    let rows: Vec<Row> = sqlx::query_as(AssertSqlSafe(rows)).bind(id_list(wanted)).fetch_all(reader).await?;
    let mut found: BTreeMap<JobId, Vec<StepRecord>> = BTreeMap::new();
    for (job, k, t, document, error, blob, sha256, bytes) in rows {
        let step = StepRecord { k: to_u32(k), t, document, error, blob, sha256, bytes: to_u64(bytes) };
        found.entry(parse_id(&job)?).or_default().push(step);
    }
    Ok(found)
}
