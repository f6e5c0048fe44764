use std::time::Duration;

use sqlx::AssertSqlSafe;

use super::answers::remember;
use super::dialect::{FOR_CHANGE, FOR_CLAIM, HEADS_OF_LINES, NEXT_TURN, NOW_MS, hold_queue};
use super::{Connection, Pool, Result, Transaction, jobs, new_job, sessions};
use crate::records::{parse_id, to_i64};
use crate::{Claim, Insertion, JobChange, JobId, JobRecord, Lane, NewJob, SupersedeScope};

/// SQL for the waiting jobs `w` of lane `$1` that stand in `line`, a table.
///
/// The first round has the first job of each tenant, the second round the second job, and so on. Within a round, jobs with a
/// lower `rank` come first, then those of the tenant whose last turn is longest ago. `rank` is an expression of the job `j`.
fn waiting(rank: &str, line: &str) -> String {
    format!(
        "(SELECT j.*, row_number() OVER (PARTITION BY j.tenant ORDER BY j.rank, j.number) AS round, coalesce(t.last, 0) AS last
          FROM (SELECT j.id, j.number, j.tenant, j.lane, {rank} AS rank FROM {line} j
                WHERE j.state = 'accepted' AND j.lane = $1 AND j.cancel_requested_at IS NULL) AS j
          LEFT JOIN turns t ON t.tenant = j.tenant AND t.lane = j.lane) AS w"
    )
}

/// Puts the jobs of [`waiting`] into claiming order.
const IN_ORDER: &str = "ORDER BY w.round, w.rank, w.last, w.number";
/// The table of all jobs.
const ALL: &str = "jobs";
/// Largest number of jobs that a claim tries to lock: more than there are workers at once.
const TRIES: u32 = 64;

/// SQL for the rank of the job `j` for worker `$2`.
///
/// The worker that began a session's last job knows the session.
///
/// - 0: a job of a session that this worker or no worker knows, or one that has waited longer than the patience `$4`.
/// - 1: a job of a session that another worker knows.
/// - 2: the same, still left to that worker because it has waited for less than the head start `$3`.
fn rank() -> String {
    format!(
        "CASE WHEN $2 IS NULL OR coalesce(j.waits_since, 0) + $4 < {NOW_MS} THEN 0
              WHEN coalesce((SELECT p.worker FROM jobs p WHERE p.session = j.session AND p.worker IS NOT NULL
                             ORDER BY p.id DESC LIMIT 1), $2) = $2 THEN 0
              WHEN coalesce(j.waits_since, 0) + $3 < {NOW_MS} THEN 1 ELSE 2 END"
    )
}

pub(super) async fn insert(writer: &Pool, new: &NewJob<'_>) -> Result<Insertion> {
    let mut transaction = writer.begin().await?;
    sessions::hold(&mut transaction, new.job.session).await?;
    if let Some(twin) = twin(&mut transaction, new).await? {
        let before = before(&mut transaction, &twin).await?;
        remember(&mut transaction, (new.answer)(&twin, before).as_ref()).await?;
        transaction.commit().await?;
        return Ok(Insertion::Twin(Box::new(twin), before));
    }
    hold_queue(&mut transaction).await?;
    let superseded = supersede(&mut transaction, new).await?;
    let job = new.job;
    let (all, own): (i64, i64) = sqlx::query_as(
        "SELECT count(*), count(*) FILTER (WHERE tenant = (SELECT tenant FROM sessions WHERE id = $1))
         FROM jobs WHERE state = 'accepted'",
    )
    .bind(job.session.to_string())
    .fetch_one(&mut *transaction)
    .await?;
    // Returning drops the transaction, which undoes the superseding.
    if all >= i64::from(new.limits.all) {
        return Ok(Insertion::Full);
    }
    if own >= i64::from(new.limits.tenant) {
        return Ok(Insertion::TenantFull);
    }
    new_job::add(&mut transaction, job, new.event).await?;
    let before = before(&mut transaction, job).await?;
    remember(&mut transaction, (new.answer)(job, before).as_ref()).await?;
    transaction.commit().await?;
    Ok(Insertion::Stored { superseded, before: before.unwrap_or(0) })
}

/// Number of jobs before one in its lane; `None` when the job does not wait.
async fn before(transaction: &mut Transaction<'_>, job: &JobRecord) -> Result<Option<u32>> {
    let ids = ids_in_order(transaction, job.kind.lane()).await?;
    let own = job.id.to_string();
    Ok(ids.iter().position(|id| *id == own).and_then(|n| u32::try_from(n).ok()))
}

/// An unfinished job of the session with the same request, whose cancellation was not requested.
async fn twin(transaction: &mut Transaction<'_>, new: &NewJob<'_>) -> Result<Option<JobRecord>> {
    let row = sqlx::query(
        "SELECT * FROM jobs WHERE session = $1 AND kind = $2 AND request = $3
         AND state IN ('accepted', 'running', 'interrupted') AND cancel_requested_at IS NULL ORDER BY number LIMIT 1",
    )
    .bind(new.job.session.to_string())
    .bind(new.job.kind.as_str())
    .bind(&new.job.request)
    .fetch_optional(&mut **transaction)
    .await?;
    row.as_ref().map(jobs::record).transpose()
}

async fn supersede(transaction: &mut Transaction<'_>, new: &NewJob<'_>) -> Result<Vec<(JobId, Option<String>)>> {
    let Some(supersede) = &new.supersede else { return Ok(Vec::new()) };
    // A job without subject has no equal.
    let subject = match (supersede.scope, &new.job.subject) {
        (SupersedeScope::Session, _) => None,
        (SupersedeScope::Subject, Some(subject)) => Some(subject),
        (SupersedeScope::Subject, None) => return Ok(Vec::new()),
    };
    let rows = format!(
        "SELECT * FROM jobs WHERE session = $1 AND kind = $2 AND ($3 IS NULL OR subject = $3) AND state = $4
         ORDER BY id {FOR_CHANGE}"
    );
    let rows = sqlx::query(AssertSqlSafe(rows))
        .bind(new.job.session.to_string())
        .bind(new.job.kind.as_str())
        .bind(subject)
        .bind(supersede.from.as_str())
        .fetch_all(&mut **transaction)
        .await?;
    let mut superseded = Vec::new();
    for row in &rows {
        let old = jobs::record(row)?;
        let change = JobChange { events: vec![supersede.event.clone()], ..JobChange::default() };
        jobs::write_change(transaction, &old, supersede.to, &change).await?;
        sqlx::query("UPDATE jobs SET superseded_by = $1 WHERE id = $2")
            .bind(new.job.id.to_string())
            .bind(old.id.to_string())
            .execute(&mut **transaction)
            .await?;
        superseded.push((old.id, old.checkpoint_blob));
    }
    Ok(superseded)
}

/// Ids of the waiting jobs of a lane, in claiming order.
async fn ids_in_order(connection: &mut Connection, lane: Lane) -> Result<Vec<String>> {
    let ids = format!("SELECT w.id FROM {} {IN_ORDER}", waiting("0", ALL));
    let ids = sqlx::query_scalar(AssertSqlSafe(ids));
    Ok(ids.bind(lane.as_str()).fetch_all(connection).await?)
}

pub(super) async fn in_order(reader: &Pool, lane: Lane) -> Result<Vec<JobId>> {
    let mut connection = reader.acquire().await?;
    ids_in_order(&mut connection, lane).await?.iter().map(|id| parse_id(id)).collect()
}

pub(super) async fn claim(
    writer: &Pool,
    claim: &Claim,
    change: &(dyn for<'a> Fn(&'a JobRecord) -> JobChange + Send + Sync),
) -> Result<Option<JobRecord>> {
    let mut transaction = writer.begin().await?;
    let Some(job) = first_open(&mut transaction, claim).await? else { return Ok(None) };
    jobs::write_change(&mut transaction, &job, claim.to, &change(&job)).await?;
    let turn = format!(
        "INSERT INTO turns (tenant, lane, last) VALUES ($1, $2, {NEXT_TURN})
         ON CONFLICT (tenant, lane) DO UPDATE SET last = excluded.last"
    );
    let turn = sqlx::query(AssertSqlSafe(turn)).bind(job.tenant.as_str()).bind(claim.lane.as_str());
    turn.execute(&mut *transaction).await?;
    let own = format!(
        "UPDATE jobs SET fence = fence + 1, lease_until = {NOW_MS} + $2, worker = $3 WHERE id = $1 RETURNING *"
    );
    let own = sqlx::query(AssertSqlSafe(own)).bind(job.id.to_string()).bind(milliseconds(claim.lease));
    let own = own.bind(claim.worker.map(|w| w.to_string())).fetch_one(&mut *transaction).await?;
    let claimed = jobs::record(&own)?;
    transaction.commit().await?;
    Ok(Some(claimed))
}

/// Locks the first job that may be claimed.
async fn first_open(transaction: &mut Transaction<'_>, claim: &Claim) -> Result<Option<JobRecord>> {
    // Another claim may have taken a job after the list was made, or be about to. One query for both would depend on the
    // database's statistics, which a queue outruns.
    let open = format!(
        "SELECT * FROM jobs WHERE number = $1 AND state = 'accepted' AND cancel_requested_at IS NULL {FOR_CLAIM}"
    );
    for line in HEADS_OF_LINES.iter().chain(&[ALL]) {
        let numbers =
            format!("SELECT w.number FROM {} WHERE w.rank < 2 {IN_ORDER} LIMIT {TRIES}", waiting(&rank(), line));
        let numbers = sqlx::query_scalar(AssertSqlSafe(numbers)).bind(claim.lane.as_str());
        let numbers = numbers.bind(claim.worker.map(|w| w.to_string())).bind(milliseconds(Claim::HEAD_START));
        let numbers: Vec<i64> = numbers.bind(milliseconds(claim.patience)).fetch_all(&mut **transaction).await?;
        for number in numbers {
            let job = sqlx::query(AssertSqlSafe(open.as_str())).bind(number);
            if let Some(row) = job.fetch_optional(&mut **transaction).await? {
                return jobs::record(&row).map(Some);
            }
        }
    }
    Ok(None)
}

pub(super) fn milliseconds(time: Duration) -> i64 {
    i64::try_from(time.as_millis()).unwrap_or(i64::MAX / 4)
}

pub(super) async fn renew(writer: &Pool, id: JobId, fence: u64, lease: Duration) -> Result<Option<bool>> {
    let renewed = format!(
        "UPDATE jobs SET lease_until = {NOW_MS} + $3 WHERE id = $1 AND fence = $2 AND state = 'running'
         RETURNING cancel_requested_at"
    );
    let renewed = sqlx::query_scalar(AssertSqlSafe(renewed));
    let renewed = renewed.bind(id.to_string()).bind(to_i64(fence)).bind(milliseconds(lease));
    let asked: Option<Option<String>> = renewed.fetch_optional(writer).await?;
    Ok(asked.map(|at| at.is_some()))
}

pub(super) async fn abandoned(reader: &Pool) -> Result<Vec<JobRecord>> {
    let passed =
        format!("SELECT * FROM jobs WHERE state = 'running' AND coalesce(lease_until, 0) < {NOW_MS} ORDER BY id");
    sqlx::query(AssertSqlSafe(passed)).fetch_all(reader).await?.iter().map(jobs::record).collect()
}
