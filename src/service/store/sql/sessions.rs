use std::collections::BTreeSet;

use sqlx::AssertSqlSafe;

use super::answers::remember;
use super::dialect::{FOR_CHANGE, FOR_REMOVAL, FORGET, SNAPSHOT};
use super::{Connection, Pool, Result, Transaction};
use crate::job::check_quota;
use crate::meta::Over;
use crate::records::{from_json, now_rfc3339, parse_id, to_u64};
use crate::{AnswerRecord, Owner, SessionId, SessionRecord, StoreError, TenantId};

type Row = (String, String, Option<String>, String, String);

fn record((id, tenant, label, settings, created_at): Row) -> Result<SessionRecord> {
    Ok(SessionRecord { id: parse_id(&id)?, tenant: tenant_of(&tenant)?, label, settings, created_at })
}

pub(super) fn tenant_of(text: &str) -> Result<TenantId> {
    text.parse().map_err(StoreError::record)
}

pub(super) async fn insert(writer: &Pool, session: &SessionRecord, answer: Option<&AnswerRecord>) -> Result<()> {
    let mut transaction = writer.begin().await?;
    sqlx::query("INSERT INTO sessions (id, tenant, label, settings, created_at) VALUES ($1, $2, $3, $4, $5)")
        .bind(session.id.to_string())
        .bind(session.tenant.as_str())
        .bind(&session.label)
        .bind(&session.settings)
        .bind(&session.created_at)
        .execute(&mut *transaction)
        .await?;
    remember(&mut transaction, answer).await?;
    Ok(transaction.commit().await?)
}

/// Locks the row of a session until the transaction ends.
pub(super) async fn hold(transaction: &mut Transaction<'_>, id: SessionId) -> Result<()> {
    let row = sqlx::query(AssertSqlSafe(format!("SELECT id FROM sessions WHERE id = $1 {FOR_CHANGE}")));
    let row = row.bind(id.to_string()).fetch_optional(&mut **transaction).await?;
    row.map(|_| ()).ok_or(StoreError::SessionGone)
}

pub(super) async fn one(reader: &Pool, id: SessionId) -> Result<Option<SessionRecord>> {
    let row = sqlx::query_as::<_, Row>("SELECT id, tenant, label, settings, created_at FROM sessions WHERE id = $1");
    row.bind(id.to_string()).fetch_optional(reader).await?.map(record).transpose()
}

pub(super) async fn page(
    reader: &Pool,
    tenant: Option<&TenantId>,
    before: Option<SessionId>,
    limit: u32,
) -> Result<Vec<SessionRecord>> {
    // Ids are version 7 UUIDs: their order is the order of creation.
    let rows = sqlx::query_as::<_, Row>(
        "SELECT id, tenant, label, settings, created_at FROM sessions s
         WHERE ($1 IS NULL OR id < $1) AND ($2 IS NULL OR tenant = $2)
         AND NOT EXISTS (SELECT 1 FROM tombstones WHERE id = s.id) ORDER BY id DESC LIMIT $3",
    )
    .bind(before.map(|id| id.to_string()))
    .bind(tenant.map(TenantId::as_str))
    .bind(i64::from(limit))
    .fetch_all(reader)
    .await?;
    rows.into_iter().map(record).collect()
}

pub(super) async fn delete(writer: &Pool, id: SessionId) -> Result<Option<Vec<String>>> {
    let mut transaction = writer.begin().await?;
    if !bury(&mut transaction, id, false).await? {
        return Ok(None);
    }
    let elsewhere: Vec<String> = sqlx::query_scalar(
        "SELECT rest_blob FROM jobs WHERE other_session = $1 AND session <> $1 AND rest_blob IS NOT NULL
         UNION SELECT tissue_blob FROM jobs WHERE other_session = $1 AND session <> $1 AND tissue_blob IS NOT NULL
         UNION SELECT s.blob FROM steps s JOIN jobs j ON j.id = s.job WHERE j.other_session = $1 AND j.session <> $1",
    )
    .bind(id.to_string())
    .fetch_all(&mut *transaction)
    .await?;
    sqlx::query("DELETE FROM sessions WHERE id = $1").bind(id.to_string()).execute(&mut *transaction).await?;
    transaction.commit().await?;
    if let Some(forget) = FORGET
        && let Err(error) = sqlx::raw_sql(forget).execute(writer).await
    {
        tracing::warn!(%error, "the write-ahead log keeps values of a deleted session for now");
    }
    Ok(Some(elsewhere))
}

/// Writes tombstones for a session, for everything in it and for the jobs that read it.
///
/// Deletes the stored answers of the session. Returns false when the session does not exist.
async fn bury(transaction: &mut Transaction<'_>, id: SessionId, expired: bool) -> Result<bool> {
    // The locks keep other transactions from adding to the session and from changing jobs that read it.
    let held = format!("SELECT id FROM sessions WHERE id = $1 {FOR_REMOVAL}");
    let held = sqlx::query(AssertSqlSafe(held)).bind(id.to_string()).fetch_optional(&mut **transaction).await?;
    if held.is_none() {
        return Ok(false);
    }
    let jobs = format!("SELECT id FROM jobs WHERE session = $1 OR other_session = $1 ORDER BY id {FOR_REMOVAL}");
    sqlx::query(AssertSqlSafe(jobs)).bind(id.to_string()).fetch_all(&mut **transaction).await?;
    sqlx::query(
        "INSERT INTO tombstones (id, deleted_at, tenant, ran_ms, expired)
         SELECT b.id, $2, b.tenant, (SELECT coalesce(max(ran_ms), 0) FROM store), $3 FROM (
             SELECT id, tenant FROM sessions WHERE id = $1
             UNION ALL SELECT o.id, s.tenant FROM osteotomies o JOIN sessions s ON s.id = o.session WHERE o.session = $1
             UNION ALL SELECT p.id, s.tenant FROM plans p JOIN sessions s ON s.id = p.session WHERE p.session = $1
             UNION ALL SELECT id, tenant FROM jobs WHERE session = $1 OR other_session = $1) AS b
         WHERE true ON CONFLICT (id) DO NOTHING",
    )
    .bind(id.to_string())
    .bind(now_rfc3339())
    .bind(i64::from(expired))
    .execute(&mut **transaction)
    .await?;
    sqlx::query("DELETE FROM answers WHERE session = $1").bind(id.to_string()).execute(&mut **transaction).await?;
    Ok(true)
}

pub(super) async fn hide(writer: &Pool, id: SessionId, expired: bool) -> Result<bool> {
    let mut transaction = writer.begin().await?;
    let hidden = sqlx::query_scalar::<_, i64>("SELECT count(*) FROM tombstones WHERE id = $1").bind(id.to_string());
    if hidden.fetch_one(&mut *transaction).await? > 0 || !bury(&mut transaction, id, expired).await? {
        return Ok(false);
    }
    transaction.commit().await?;
    Ok(true)
}

pub(super) async fn restore(writer: &Pool, id: SessionId) -> Result<bool> {
    let mut transaction = writer.begin().await?;
    let held = format!("SELECT id FROM sessions WHERE id = $1 {FOR_REMOVAL}");
    let held = sqlx::query(AssertSqlSafe(held)).bind(id.to_string()).fetch_optional(&mut *transaction).await?;
    let stone = sqlx::query("DELETE FROM tombstones WHERE id = $1").bind(id.to_string());
    if held.is_none() || stone.execute(&mut *transaction).await?.rows_affected() == 0 {
        return Ok(false);
    }
    let used = sqlx::query("UPDATE sessions SET restored_at = $2 WHERE id = $1").bind(id.to_string());
    used.bind(now_rfc3339()).execute(&mut *transaction).await?;
    // A comparison of two sessions stays hidden while either session is hidden.
    sqlx::query(
        "DELETE FROM tombstones WHERE id IN (
             SELECT id FROM osteotomies WHERE session = $1 UNION SELECT id FROM plans WHERE session = $1
             UNION SELECT j.id FROM jobs j WHERE (j.session = $1 OR j.other_session = $1) AND NOT EXISTS (
                 SELECT 1 FROM tombstones t WHERE t.id = j.session OR t.id = j.other_session))",
    )
    .bind(id.to_string())
    .execute(&mut *transaction)
    .await?;
    transaction.commit().await?;
    Ok(true)
}

pub(super) async fn hidden(reader: &Pool, over: &Over) -> Result<Vec<SessionRecord>> {
    let query = format!(
        "SELECT s.id, s.tenant, s.label, s.settings, s.created_at FROM sessions s JOIN tombstones t ON t.id = s.id
         WHERE (t.deleted_at < $1 OR t.deleted_at > $2) AND t.ran_ms <= $3
         AND (t.expired = 0 OR {LAST_USED} < $4) ORDER BY s.id"
    );
    let rows = sqlx::query_as::<_, Row>(AssertSqlSafe(query)).bind(&over.before).bind(&over.now).bind(over.ran_ms);
    rows.bind(&over.unused_since).fetch_all(reader).await?.into_iter().map(record).collect()
}

pub(super) async fn wrongly_expired(reader: &Pool, since: &str) -> Result<Vec<SessionRecord>> {
    let query = format!(
        "SELECT s.id, s.tenant, s.label, s.settings, s.created_at FROM sessions s JOIN tombstones t ON t.id = s.id
         WHERE t.expired = 1 AND {LAST_USED} >= $1 ORDER BY s.id"
    );
    let rows = sqlx::query_as::<_, Row>(AssertSqlSafe(query)).bind(since).fetch_all(reader).await?;
    rows.into_iter().map(record).collect()
}

pub(super) async fn count_hidden(reader: &Pool) -> Result<u64> {
    let count = sqlx::query_scalar("SELECT count(*) FROM sessions s JOIN tombstones t ON t.id = s.id");
    Ok(to_u64(count.fetch_one(reader).await?))
}

/// SQL for the time of the last change in the session `s`; times of the same form sort as text.
const LAST_USED: &str = "(SELECT max(at) FROM (
    SELECT s.created_at AS at
    UNION ALL SELECT s.restored_at
    UNION ALL SELECT max(updated_at) FROM parts WHERE session = s.id
    UNION ALL SELECT max(created_at) FROM osteotomies WHERE session = s.id
    UNION ALL SELECT max(created_at) FROM plans WHERE session = s.id
    UNION ALL SELECT max(created_at) FROM jobs WHERE session = s.id
    UNION ALL SELECT max(finished_at) FROM jobs WHERE session = s.id) AS used)";

pub(super) async fn idle(reader: &Pool, since: &str) -> Result<Vec<SessionRecord>> {
    let query = format!(
        "SELECT id, tenant, label, settings, created_at FROM sessions s WHERE {LAST_USED} < $1
         AND NOT EXISTS (SELECT 1 FROM tombstones WHERE id = s.id)
         AND NOT EXISTS (SELECT 1 FROM jobs WHERE session = s.id AND state IN ('accepted', 'running', 'interrupted'))
         ORDER BY id"
    );
    let rows = sqlx::query_as::<_, Row>(AssertSqlSafe(query)).bind(since).fetch_all(reader).await?;
    rows.into_iter().map(record).collect()
}

pub(super) async fn last_used(reader: &Pool, id: SessionId) -> Result<Option<String>> {
    let query = format!("SELECT {LAST_USED} FROM sessions s WHERE s.id = $1");
    Ok(sqlx::query_scalar(AssertSqlSafe(query)).bind(id.to_string()).fetch_optional(reader).await?)
}

pub(super) async fn owner(reader: &Pool, id: &str) -> Result<Option<Owner>> {
    let row: Option<(String, bool)> = sqlx::query_as(
        "SELECT tenant, TRUE AS deleted FROM tombstones WHERE id = $1
         UNION ALL SELECT tenant, FALSE FROM sessions WHERE id = $1
         UNION ALL SELECT tenant, FALSE FROM jobs WHERE id = $1 ORDER BY deleted DESC LIMIT 1",
    )
    .bind(id)
    .fetch_optional(reader)
    .await?;
    row.map(|(tenant, deleted)| Ok(Owner { tenant: tenant_of(&tenant)?, deleted })).transpose()
}

pub(super) async fn is_deleted(reader: &Pool, id: &str) -> Result<bool> {
    let found = sqlx::query_scalar::<_, i64>("SELECT count(*) FROM tombstones WHERE id = $1").bind(id);
    Ok(found.fetch_one(reader).await? > 0)
}

/// SQL for the bytes stored for the session `s`.
pub(super) const BYTES: &str = "CAST((SELECT coalesce(sum(bytes), 0) FROM parts WHERE session = s.id)
    + (SELECT coalesce(sum(bytes), 0) FROM osteotomies WHERE session = s.id)
    + (SELECT coalesce(sum(bytes), 0) FROM jobs WHERE session = s.id)
    + (SELECT coalesce(sum(steps.bytes), 0) FROM steps JOIN jobs ON jobs.id = steps.job WHERE session = s.id) AS BIGINT)";

pub(super) async fn bytes(connection: &mut Connection, id: SessionId) -> Result<u64> {
    let query = format!("SELECT {BYTES} FROM sessions s WHERE s.id = $1");
    let query = sqlx::query_scalar(AssertSqlSafe(query)).bind(id.to_string());
    Ok(query.fetch_optional(connection).await?.map_or(0, to_u64))
}

pub(super) async fn check_bytes(connection: &mut Connection, id: SessionId, quota: u64) -> Result<()> {
    check_quota(bytes(connection, id).await?, quota)
}

pub(super) async fn named_blobs(reader: &Pool) -> Result<BTreeSet<String>> {
    // One read transaction, so that a key that moves to another table meanwhile is found in one of them.
    let mut transaction = reader.begin_with(SNAPSHOT).await?;
    let mut named: BTreeSet<String> = sqlx::query_scalar(
        "SELECT blob FROM parts WHERE blob IS NOT NULL
         UNION SELECT rest_blob FROM jobs WHERE rest_blob IS NOT NULL
         UNION SELECT tissue_blob FROM jobs WHERE tissue_blob IS NOT NULL
         UNION SELECT milestone_blob FROM jobs WHERE milestone_blob IS NOT NULL
         UNION SELECT blob FROM steps",
    )
    .fetch_all(&mut *transaction)
    .await?
    .into_iter()
    .collect();
    let lists: Vec<String> = sqlx::query_scalar("SELECT blobs FROM osteotomies").fetch_all(&mut *transaction).await?;
    transaction.rollback().await?;
    for list in lists {
        named.extend(from_json::<Vec<String>>("blobs of an osteotomy", &list)?);
    }
    Ok(named)
}
