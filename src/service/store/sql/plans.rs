use sqlx::AssertSqlSafe;

use super::answers::remember;
use super::dialect::FOR_REMOVAL;
use super::{Pool, Result, gone_if_orphan, sessions};
use crate::records::{from_json, now_rfc3339, parse_id, to_i64, to_json, to_u64};
use crate::{AnswerRecord, OsteotomyId, OsteotomyRecord, PlanId, PlanRecord, SessionId};

type OsteotomyRow = (String, String, String, f64, i64, String, String, String);
type PlanRow = (String, String, Option<String>, String, String);

fn osteotomy(row: OsteotomyRow) -> Result<OsteotomyRecord> {
    let (id, session, field_key, wall_s, bytes, document, blobs, created_at) = row;
    Ok(OsteotomyRecord {
        id: parse_id(&id)?,
        session: parse_id(&session)?,
        field_key,
        wall_s,
        bytes: to_u64(bytes),
        document,
        blobs: from_json("blobs of an osteotomy", &blobs)?,
        created_at,
    })
}

fn plan((id, session, osteotomy, document, created_at): PlanRow) -> Result<PlanRecord> {
    let osteotomy = osteotomy.as_deref().map(parse_id).transpose()?;
    Ok(PlanRecord { id: parse_id(&id)?, session: parse_id(&session)?, osteotomy, document, created_at })
}

pub(super) async fn insert_osteotomy(
    writer: &Pool,
    record: &OsteotomyRecord,
    answer: Option<&AnswerRecord>,
    quota: u64,
) -> Result<()> {
    let mut transaction = writer.begin().await?;
    sessions::hold(&mut transaction, record.session).await?;
    sqlx::query(
        "INSERT INTO osteotomies (id, session, field_key, wall_s, bytes, document, blobs, created_at)
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8)",
    )
    .bind(record.id.to_string())
    .bind(record.session.to_string())
    .bind(&record.field_key)
    .bind(record.wall_s)
    .bind(to_i64(record.bytes))
    .bind(&record.document)
    .bind(to_json("blobs of an osteotomy", &record.blobs)?)
    .bind(&record.created_at)
    .execute(&mut *transaction)
    .await?;
    sessions::check_bytes(&mut transaction, record.session, quota).await?;
    remember(&mut transaction, answer).await?;
    Ok(transaction.commit().await?)
}

pub(super) async fn osteotomies(reader: &Pool, session: SessionId) -> Result<Vec<OsteotomyRecord>> {
    let rows = sqlx::query_as::<_, OsteotomyRow>(
        "SELECT id, session, field_key, wall_s, bytes, document, blobs, created_at
         FROM osteotomies WHERE session = $1 ORDER BY id",
    );
    rows.bind(session.to_string()).fetch_all(reader).await?.into_iter().map(osteotomy).collect()
}

pub(super) async fn delete_osteotomy(
    writer: &Pool,
    session: SessionId,
    id: OsteotomyId,
) -> Result<Option<Vec<String>>> {
    let mut transaction = writer.begin().await?;
    // The lock keeps other transactions from storing a plan for this osteotomy.
    let held = format!("SELECT id FROM osteotomies WHERE id = $1 {FOR_REMOVAL}");
    sqlx::query(AssertSqlSafe(held)).bind(id.to_string()).fetch_optional(&mut *transaction).await?;
    sqlx::query(
        "INSERT INTO tombstones (id, deleted_at, tenant)
         SELECT p.id, $3, s.tenant FROM plans p JOIN sessions s ON s.id = p.session WHERE p.osteotomy = $1 AND p.session = $2
         UNION ALL SELECT o.id, $3, s.tenant FROM osteotomies o JOIN sessions s ON s.id = o.session
         WHERE o.id = $1 AND o.session = $2 ON CONFLICT (id) DO NOTHING",
    )
    .bind(id.to_string())
    .bind(session.to_string())
    .bind(now_rfc3339())
    .execute(&mut *transaction)
    .await?;
    let blobs: Option<String> =
        sqlx::query_scalar("DELETE FROM osteotomies WHERE id = $1 AND session = $2 RETURNING blobs")
            .bind(id.to_string())
            .bind(session.to_string())
            .fetch_optional(&mut *transaction)
            .await?;
    transaction.commit().await?;
    blobs.map(|blobs| from_json("blobs of an osteotomy", &blobs)).transpose()
}

pub(super) async fn insert_plan(writer: &Pool, record: &PlanRecord, answer: Option<&AnswerRecord>) -> Result<()> {
    let mut transaction = writer.begin().await?;
    sqlx::query("INSERT INTO plans (id, session, osteotomy, document, created_at) VALUES ($1, $2, $3, $4, $5)")
        .bind(record.id.to_string())
        .bind(record.session.to_string())
        .bind(record.osteotomy.map(|o| o.to_string()))
        .bind(&record.document)
        .bind(&record.created_at)
        .execute(&mut *transaction)
        .await
        .map_err(gone_if_orphan)?;
    remember(&mut transaction, answer).await?;
    Ok(transaction.commit().await?)
}

pub(super) async fn plans(reader: &Pool, session: SessionId) -> Result<Vec<PlanRecord>> {
    let rows = sqlx::query_as::<_, PlanRow>(
        "SELECT id, session, osteotomy, document, created_at FROM plans WHERE session = $1 ORDER BY id",
    );
    rows.bind(session.to_string()).fetch_all(reader).await?.into_iter().map(plan).collect()
}

pub(super) async fn set_plan(writer: &Pool, session: SessionId, id: PlanId, document: &str) -> Result<()> {
    sqlx::query("UPDATE plans SET document = $3 WHERE session = $1 AND id = $2")
        .bind(session.to_string())
        .bind(id.to_string())
        .bind(document)
        .execute(writer)
        .await?;
    Ok(())
}

pub(super) async fn delete_plan(writer: &Pool, session: SessionId, id: PlanId) -> Result<bool> {
    let mut transaction = writer.begin().await?;
    sqlx::query(
        "INSERT INTO tombstones (id, deleted_at, tenant)
         SELECT p.id, $3, s.tenant FROM plans p JOIN sessions s ON s.id = p.session
         WHERE p.id = $1 AND p.session = $2 ON CONFLICT (id) DO NOTHING",
    )
    .bind(id.to_string())
    .bind(session.to_string())
    .bind(now_rfc3339())
    .execute(&mut *transaction)
    .await?;
    let deleted = sqlx::query("DELETE FROM plans WHERE session = $1 AND id = $2")
        .bind(session.to_string())
        .bind(id.to_string())
        .execute(&mut *transaction)
        .await?;
    transaction.commit().await?;
    Ok(deleted.rows_affected() > 0)
}
