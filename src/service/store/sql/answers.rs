use super::{Pool, Result, Transaction};
use crate::records::now_rfc3339;
use crate::{AnswerRecord, StoreError, StoredAnswer, TenantId};

/// Stores the answer in the transaction that creates the thing, so that either both exist or neither.
pub(super) async fn remember(transaction: &mut Transaction<'_>, answer: Option<&AnswerRecord>) -> Result<()> {
    let Some(answer) = answer else { return Ok(()) };
    sqlx::query(
        "INSERT INTO answers (tenant, key, request_sha256, status, location, retry_after, body, session, created_at)
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9)",
    )
    .bind(answer.tenant.as_str())
    .bind(&answer.key)
    .bind(&answer.request_sha256)
    .bind(i64::from(answer.status))
    .bind(&answer.location)
    .bind(&answer.retry_after)
    .bind(&answer.body)
    .bind(answer.session.map(|s| s.to_string()))
    .bind(now_rfc3339())
    .execute(&mut **transaction)
    .await
    .map_err(|error| {
        let taken = error.as_database_error().is_some_and(sqlx::error::DatabaseError::is_unique_violation);
        if taken { StoreError::KeyTaken } else { error.into() }
    })?;
    Ok(())
}

pub(super) async fn remembered(
    reader: &Pool,
    tenant: &TenantId,
    key: &str,
    request_sha256: &str,
) -> Result<StoredAnswer> {
    type Row = (String, i64, Option<String>, Option<String>, String);
    let row: Option<Row> = sqlx::query_as(
        "SELECT request_sha256, status, location, retry_after, body FROM answers WHERE tenant = $1 AND key = $2",
    )
    .bind(tenant.as_str())
    .bind(key)
    .fetch_optional(reader)
    .await?;
    let Some((found, status, location, retry_after, body)) = row else { return Ok(StoredAnswer::Nothing) };
    if found != request_sha256 {
        return Ok(StoredAnswer::OtherRequest);
    }
    Ok(StoredAnswer::Answer(AnswerRecord {
        tenant: tenant.clone(),
        key: key.to_owned(),
        request_sha256: found,
        status: u16::try_from(status).unwrap_or(500),
        location,
        retry_after,
        body,
        session: None,
    }))
}

pub(super) async fn forget(writer: &Pool, answers: &str, tombstones: &str) -> Result<()> {
    let mut transaction = writer.begin().await?;
    sqlx::query("DELETE FROM answers WHERE created_at < $1").bind(answers).execute(&mut *transaction).await?;
    // A hidden session can still be restored, and would be visible again without its tombstone.
    sqlx::query(
        "DELETE FROM tombstones WHERE deleted_at < $1
         AND id NOT IN (SELECT id FROM sessions) AND id NOT IN (SELECT id FROM jobs)
         AND id NOT IN (SELECT id FROM osteotomies) AND id NOT IN (SELECT id FROM plans)",
    )
    .bind(tombstones)
    .execute(&mut *transaction)
    .await?;
    Ok(transaction.commit().await?)
}
