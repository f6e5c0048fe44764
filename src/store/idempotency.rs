use sqlx::{Sqlite, Transaction};

use super::records::now_rfc3339;
use super::{SessionId, Store, StoreError};

/// The answer to a creating request, kept under its idempotency key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AnswerRecord {
    /// The client's key.
    pub key: String,
    /// SHA-256 of method, path and payload.
    pub request_sha256: String,
    /// HTTP status.
    pub status: u16,
    /// `Location` header.
    pub location: Option<String>,
    /// `Retry-After` header.
    pub retry_after: Option<String>,
    /// Body, JSON.
    pub body: String,
    /// Forgotten together with this session.
    pub session: Option<SessionId>,
}

/// What is known of an idempotency key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Remembered {
    /// Never seen.
    Nothing,
    /// The same request was answered so.
    Answer(AnswerRecord),
    /// The key was used for another request.
    OtherRequest,
}

/// Writes the answer in the transaction that creates the thing, so that either both are there or none.
pub(super) async fn remember(
    transaction: &mut Transaction<'_, Sqlite>,
    answer: Option<&AnswerRecord>,
) -> Result<(), StoreError> {
    let Some(answer) = answer else { return Ok(()) };
    sqlx::query(
        "INSERT INTO idempotency (key, request_sha256, status, location, retry_after, body, session, created_at)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
    )
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
        if taken { StoreError::KeyTaken } else { StoreError::Database(error) }
    })?;
    Ok(())
}

impl Store {
    /// Looks a key up.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn remembered(&self, key: &str, request_sha256: &str) -> Result<Remembered, StoreError> {
        type Row = (String, i64, Option<String>, Option<String>, String);
        let row: Option<Row> =
            sqlx::query_as("SELECT request_sha256, status, location, retry_after, body FROM idempotency WHERE key = ?")
                .bind(key)
                .fetch_optional(&self.reader)
                .await?;
        let Some((found, status, location, retry_after, body)) = row else { return Ok(Remembered::Nothing) };
        if found != request_sha256 {
            return Ok(Remembered::OtherRequest);
        }
        Ok(Remembered::Answer(AnswerRecord {
            key: key.to_owned(),
            request_sha256: found,
            status: u16::try_from(status).unwrap_or(500),
            location,
            retry_after,
            body,
            session: None,
        }))
    }
}
