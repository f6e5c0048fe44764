use std::collections::BTreeSet;

use sqlx::{SqliteConnection, SqlitePool};

use super::Result;
use super::answers::remember;
use crate::store::job::check_quota;
use crate::store::records::{from_json, now_rfc3339, parse_id, to_u64};
use crate::store::{AnswerRecord, Owner, SessionId, SessionRecord, StoreError, TenantId};

type Row = (String, String, Option<String>, String, String);

fn record((id, tenant, label, settings, created_at): Row) -> Result<SessionRecord> {
    Ok(SessionRecord { id: parse_id(&id)?, tenant: tenant_of(&tenant)?, label, settings, created_at })
}

pub(super) fn tenant_of(text: &str) -> Result<TenantId> {
    text.parse().map_err(StoreError::record)
}

pub(super) async fn insert(writer: &SqlitePool, session: &SessionRecord, answer: Option<&AnswerRecord>) -> Result<()> {
    let mut transaction = writer.begin().await?;
    sqlx::query("INSERT INTO sessions (id, tenant, label, settings, created_at) VALUES (?, ?, ?, ?, ?)")
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

pub(super) async fn one(reader: &SqlitePool, id: SessionId) -> Result<Option<SessionRecord>> {
    let row = sqlx::query_as::<_, Row>("SELECT id, tenant, label, settings, created_at FROM sessions WHERE id = ?");
    row.bind(id.to_string()).fetch_optional(reader).await?.map(record).transpose()
}

pub(super) async fn page(
    reader: &SqlitePool,
    tenant: Option<&TenantId>,
    before: Option<SessionId>,
    limit: u32,
) -> Result<Vec<SessionRecord>> {
    // Ids are version 7 UUIDs: their order is the order of creation.
    let rows = sqlx::query_as::<_, Row>(
        "SELECT id, tenant, label, settings, created_at FROM sessions
         WHERE (?1 IS NULL OR id < ?1) AND (?2 IS NULL OR tenant = ?2) ORDER BY id DESC LIMIT ?3",
    )
    .bind(before.map(|id| id.to_string()))
    .bind(tenant.map(TenantId::as_str))
    .bind(i64::from(limit))
    .fetch_all(reader)
    .await?;
    rows.into_iter().map(record).collect()
}

pub(super) async fn delete(writer: &SqlitePool, id: SessionId) -> Result<Option<Vec<String>>> {
    let mut transaction = writer.begin().await?;
    sqlx::query(
        "INSERT OR IGNORE INTO tombstones (id, deleted_at, tenant)
         SELECT id, ?2, tenant FROM sessions WHERE id = ?1
         UNION ALL SELECT o.id, ?2, s.tenant FROM osteotomies o JOIN sessions s ON s.id = o.session WHERE o.session = ?1
         UNION ALL SELECT p.id, ?2, s.tenant FROM plans p JOIN sessions s ON s.id = p.session WHERE p.session = ?1
         UNION ALL SELECT id, ?2, tenant FROM jobs WHERE session = ?1 OR other_session = ?1",
    )
    .bind(id.to_string())
    .bind(now_rfc3339())
    .execute(&mut *transaction)
    .await?;
    sqlx::query("DELETE FROM answers WHERE session = ?").bind(id.to_string()).execute(&mut *transaction).await?;
    let elsewhere: Vec<String> = sqlx::query_scalar(
        "SELECT rest_blob FROM jobs WHERE other_session = ?1 AND session <> ?1 AND rest_blob IS NOT NULL
         UNION SELECT tissue_blob FROM jobs WHERE other_session = ?1 AND session <> ?1 AND tissue_blob IS NOT NULL
         UNION SELECT s.blob FROM steps s JOIN jobs j ON j.id = s.job WHERE j.other_session = ?1 AND j.session <> ?1",
    )
    .bind(id.to_string())
    .fetch_all(&mut *transaction)
    .await?;
    let deleted =
        sqlx::query("DELETE FROM sessions WHERE id = ?").bind(id.to_string()).execute(&mut *transaction).await?;
    transaction.commit().await?;
    Ok((deleted.rows_affected() > 0).then_some(elsewhere))
}

/// When something was last made or changed in the session `s`; times of the same form sort as texts.
const LAST_USED: &str = "max(s.created_at,
    coalesce((SELECT max(updated_at) FROM parts WHERE session = s.id), ''),
    coalesce((SELECT max(created_at) FROM osteotomies WHERE session = s.id), ''),
    coalesce((SELECT max(created_at) FROM plans WHERE session = s.id), ''),
    coalesce((SELECT max(max(created_at, coalesce(finished_at, ''))) FROM jobs WHERE session = s.id), ''))";

pub(super) async fn idle(reader: &SqlitePool, since: &str) -> Result<Vec<SessionRecord>> {
    let query = format!(
        "SELECT id, tenant, label, settings, created_at FROM sessions s WHERE {LAST_USED} < ?
         AND NOT EXISTS (SELECT 1 FROM jobs WHERE session = s.id AND state IN ('accepted', 'running', 'interrupted'))
         ORDER BY id"
    );
    let rows = sqlx::query_as::<_, Row>(sqlx::AssertSqlSafe(query)).bind(since).fetch_all(reader).await?;
    rows.into_iter().map(record).collect()
}

pub(super) async fn last_used(reader: &SqlitePool, id: SessionId) -> Result<Option<String>> {
    let query = format!("SELECT {LAST_USED} FROM sessions s WHERE s.id = ?");
    Ok(sqlx::query_scalar(sqlx::AssertSqlSafe(query)).bind(id.to_string()).fetch_optional(reader).await?)
}

pub(super) async fn owner(reader: &SqlitePool, id: &str) -> Result<Option<Owner>> {
    let row: Option<(String, bool)> = sqlx::query_as(
        "SELECT tenant, FALSE FROM sessions WHERE id = ?1
         UNION ALL SELECT tenant, FALSE FROM jobs WHERE id = ?1
         UNION ALL SELECT tenant, TRUE FROM tombstones WHERE id = ?1 LIMIT 1",
    )
    .bind(id)
    .fetch_optional(reader)
    .await?;
    row.map(|(tenant, deleted)| Ok(Owner { tenant: tenant_of(&tenant)?, deleted })).transpose()
}

pub(super) async fn is_deleted(reader: &SqlitePool, id: &str) -> Result<bool> {
    let found: Option<i64> =
        sqlx::query_scalar("SELECT 1 FROM tombstones WHERE id = ?").bind(id).fetch_optional(reader).await?;
    Ok(found.is_some())
}

/// Bytes stored for the session `s`.
pub(super) const BYTES: &str = "(SELECT coalesce(sum(bytes), 0) FROM parts WHERE session = s.id)
    + (SELECT coalesce(sum(bytes), 0) FROM osteotomies WHERE session = s.id)
    + (SELECT coalesce(sum(bytes), 0) FROM jobs WHERE session = s.id)
    + (SELECT coalesce(sum(steps.bytes), 0) FROM steps JOIN jobs ON jobs.id = steps.job WHERE session = s.id)";

pub(super) async fn bytes(connection: &mut SqliteConnection, id: SessionId) -> Result<u64> {
    let query = format!("SELECT {BYTES} FROM sessions s WHERE s.id = ?");
    let query = sqlx::query_scalar(sqlx::AssertSqlSafe(query)).bind(id.to_string());
    Ok(query.fetch_optional(connection).await?.map_or(0, to_u64))
}

pub(super) async fn check_bytes(connection: &mut SqliteConnection, id: SessionId, quota: u64) -> Result<()> {
    check_quota(bytes(connection, id).await?, quota)
}

pub(super) async fn named_blobs(reader: &SqlitePool) -> Result<BTreeSet<String>> {
    // One read transaction: what moves from one table to another meanwhile is seen in one of them.
    let mut transaction = reader.begin().await?;
    let mut named: BTreeSet<String> = sqlx::query_scalar(
        "SELECT blob FROM parts WHERE blob IS NOT NULL
         UNION SELECT rest_blob FROM jobs WHERE rest_blob IS NOT NULL
         UNION SELECT tissue_blob FROM jobs WHERE tissue_blob IS NOT NULL
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
