use std::collections::BTreeSet;

use super::idempotency::remember;
use super::records::{from_json, now_rfc3339, parse_id, to_i64};
use super::{AnswerRecord, SessionId, Store, StoreError};

/// A session's row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SessionRecord {
    /// Its id.
    pub id: SessionId,
    /// The client's opaque tag.
    pub label: Option<String>,
    /// Settings document, JSON.
    pub settings: String,
    /// When it was made, RFC 3339.
    pub created_at: String,
}

type Row = (String, Option<String>, String, String);

fn record((id, label, settings, created_at): Row) -> Result<SessionRecord, StoreError> {
    Ok(SessionRecord { id: parse_id(&id)?, label, settings, created_at })
}

impl Store {
    /// Stores a new session together with the answer that a repeated request gets.
    ///
    /// # Errors
    /// [`StoreError::KeyTaken`] when the idempotency key was used meanwhile, [`StoreError::Database`].
    pub async fn insert_session(
        &self,
        session: &SessionRecord,
        answer: Option<&AnswerRecord>,
    ) -> Result<(), StoreError> {
        let mut transaction = self.writer.begin().await?;
        sqlx::query("INSERT INTO sessions (id, label, settings, created_at) VALUES (?, ?, ?, ?)")
            .bind(session.id.to_string())
            .bind(&session.label)
            .bind(&session.settings)
            .bind(&session.created_at)
            .execute(&mut *transaction)
            .await?;
        remember(&mut transaction, answer).await?;
        Ok(transaction.commit().await?)
    }

    /// A session, if it is there.
    ///
    /// # Errors
    /// [`StoreError::Database`], [`StoreError::Record`].
    pub async fn session(&self, id: SessionId) -> Result<Option<SessionRecord>, StoreError> {
        sqlx::query_as::<_, Row>("SELECT id, label, settings, created_at FROM sessions WHERE id = ?")
            .bind(id.to_string())
            .fetch_optional(&self.reader)
            .await?
            .map(record)
            .transpose()
    }

    /// Sessions, newest first, from those made before `before` on.
    ///
    /// # Errors
    /// [`StoreError::Database`], [`StoreError::Record`].
    pub async fn sessions(&self, before: Option<SessionId>, limit: u32) -> Result<Vec<SessionRecord>, StoreError> {
        // Ids are version 7 UUIDs: their order is the order of creation.
        let rows = sqlx::query_as::<_, Row>(
            "SELECT id, label, settings, created_at FROM sessions WHERE ?1 IS NULL OR id < ?1 ORDER BY id DESC LIMIT ?2",
        )
        .bind(before.map(|id| id.to_string()))
        .bind(i64::from(limit))
        .fetch_all(&self.reader)
        .await?;
        rows.into_iter().map(record).collect()
    }

    /// Deletes a session with everything in it; its ids answer [`Store::is_deleted`] from then on. False when it was not there.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn delete_session(&self, id: SessionId) -> Result<bool, StoreError> {
        let mut transaction = self.writer.begin().await?;
        let now = now_rfc3339();
        sqlx::query(
            "INSERT OR IGNORE INTO tombstones (id, deleted_at)
             SELECT id, ?2 FROM sessions WHERE id = ?1
             UNION ALL SELECT id, ?2 FROM osteotomies WHERE session = ?1
             UNION ALL SELECT id, ?2 FROM plans WHERE session = ?1
             UNION ALL SELECT id, ?2 FROM jobs WHERE session = ?1",
        )
        .bind(id.to_string())
        .bind(now)
        .execute(&mut *transaction)
        .await?;
        sqlx::query("DELETE FROM idempotency WHERE session = ?")
            .bind(id.to_string())
            .execute(&mut *transaction)
            .await?;
        let deleted =
            sqlx::query("DELETE FROM sessions WHERE id = ?").bind(id.to_string()).execute(&mut *transaction).await?;
        transaction.commit().await?;
        if deleted.rows_affected() > 0 {
            self.blobs().delete_session(id).await?;
        }
        Ok(deleted.rows_affected() > 0)
    }

    /// Whether something with this id was there and was deleted.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn is_deleted(&self, id: &str) -> Result<bool, StoreError> {
        let found: Option<i64> =
            sqlx::query_scalar("SELECT 1 FROM tombstones WHERE id = ?").bind(id).fetch_optional(&self.reader).await?;
        Ok(found.is_some())
    }

    /// Bytes stored for a session.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn session_bytes(&self, id: SessionId) -> Result<u64, StoreError> {
        let bytes: i64 = sqlx::query_scalar(
            "SELECT (SELECT coalesce(sum(bytes), 0) FROM parts WHERE session = ?1)
                  + (SELECT coalesce(sum(bytes), 0) FROM osteotomies WHERE session = ?1)
                  + (SELECT coalesce(sum(bytes), 0) FROM jobs WHERE session = ?1)
                  + (SELECT coalesce(sum(steps.bytes), 0) FROM steps JOIN jobs ON jobs.id = steps.job WHERE session = ?1)",
        )
        .bind(id.to_string())
        .fetch_one(&self.reader)
        .await?;
        Ok(super::records::to_u64(bytes))
    }

    /// Keys of all blobs that a row names.
    pub(super) async fn named_blobs(&self) -> Result<BTreeSet<String>, StoreError> {
        let mut named: BTreeSet<String> = sqlx::query_scalar(
            "SELECT blob FROM parts WHERE blob IS NOT NULL
             UNION SELECT rest_blob FROM jobs WHERE rest_blob IS NOT NULL
             UNION SELECT tissue_blob FROM jobs WHERE tissue_blob IS NOT NULL
             UNION SELECT blob FROM steps",
        )
        .fetch_all(&self.reader)
        .await?
        .into_iter()
        .collect();
        let lists: Vec<String> = sqlx::query_scalar("SELECT blobs FROM osteotomies").fetch_all(&self.reader).await?;
        for list in lists {
            named.extend(from_json::<Vec<String>>("blobs of an osteotomy", &list)?);
        }
        Ok(named)
    }

    /// Forgets answers older than `days` days and tombstones older than ten times that.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn forget_old_answers(&self, days: u64) -> Result<(), StoreError> {
        let age = format!("-{} days", to_i64(days));
        sqlx::query("DELETE FROM idempotency WHERE datetime(created_at) < datetime('now', ?)")
            .bind(age)
            .execute(&self.writer)
            .await?;
        let age = format!("-{} days", to_i64(days.saturating_mul(10)));
        sqlx::query("DELETE FROM tombstones WHERE datetime(deleted_at) < datetime('now', ?)")
            .bind(age)
            .execute(&self.writer)
            .await?;
        Ok(())
    }
}
