use super::idempotency::remember;
use super::parts::{gone_if_orphan, session_of};
use super::records::{from_json, now_rfc3339, parse_id, to_i64, to_json, to_u64};
use super::{AnswerRecord, OsteotomyId, PlanId, SessionId, Store, StoreError};

/// Cuts and their bone segments.
#[derive(Debug, Clone, PartialEq)]
pub struct OsteotomyRecord {
    /// Its id.
    pub id: OsteotomyId,
    /// Its session.
    pub session: SessionId,
    /// Key of the field that it was cut from.
    pub field_key: String,
    /// Time that the cut took, s.
    pub wall_s: f64,
    /// Bytes stored.
    pub bytes: u64,
    /// Cuts and segments, JSON.
    pub document: String,
    /// Blobs of the segments' surfaces, by segment.
    pub blobs: Vec<String>,
    /// When it was made, RFC 3339.
    pub created_at: String,
}

/// Bone paths.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlanRecord {
    /// Its id.
    pub id: PlanId,
    /// Its session.
    pub session: SessionId,
    /// Whose segments move; those of the session's tissue mesh when absent.
    pub osteotomy: Option<OsteotomyId>,
    /// Paths and their report, JSON.
    pub document: String,
    /// When it was made, RFC 3339.
    pub created_at: String,
}

type OsteotomyRow = (String, String, String, f64, i64, String, String, String);
type PlanRow = (String, String, Option<String>, String, String);

fn osteotomy(row: OsteotomyRow) -> Result<OsteotomyRecord, StoreError> {
    let (id, session, field_key, wall_s, bytes, document, blobs, created_at) = row;
    Ok(OsteotomyRecord {
        id: parse_id(&id)?,
        session: session_of(&session)?,
        field_key,
        wall_s,
        bytes: to_u64(bytes),
        document,
        blobs: from_json("blobs of an osteotomy", &blobs)?,
        created_at,
    })
}

fn plan((id, session, osteotomy, document, created_at): PlanRow) -> Result<PlanRecord, StoreError> {
    let osteotomy = osteotomy.as_deref().map(parse_id).transpose()?;
    let (id, session) = (parse_id(&id)?, session_of(&session)?);
    Ok(PlanRecord { id, session, osteotomy, document, created_at })
}

impl Store {
    /// Stores an osteotomy; on failure the blobs that it names are removed.
    ///
    /// # Errors
    /// [`StoreError::SessionGone`], [`StoreError::KeyTaken`], [`StoreError::Database`].
    pub async fn insert_osteotomy(
        &self,
        record: &OsteotomyRecord,
        answer: Option<&AnswerRecord>,
    ) -> Result<(), StoreError> {
        let inserted = self.insert_osteotomy_row(record, answer).await;
        if inserted.is_err() {
            for blob in &record.blobs {
                self.blobs().delete(blob).await;
            }
        }
        inserted
    }

    async fn insert_osteotomy_row(
        &self,
        record: &OsteotomyRecord,
        answer: Option<&AnswerRecord>,
    ) -> Result<(), StoreError> {
        let mut transaction = self.writer.begin().await?;
        sqlx::query(
            "INSERT INTO osteotomies (id, session, field_key, wall_s, bytes, document, blobs, created_at)
             VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
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
        .await
        .map_err(gone_if_orphan)?;
        remember(&mut transaction, answer).await?;
        Ok(transaction.commit().await?)
    }

    /// Osteotomies of a session, oldest first.
    ///
    /// # Errors
    /// [`StoreError::Database`], [`StoreError::Record`].
    pub async fn osteotomies(&self, session: SessionId) -> Result<Vec<OsteotomyRecord>, StoreError> {
        let rows = sqlx::query_as::<_, OsteotomyRow>(
            "SELECT id, session, field_key, wall_s, bytes, document, blobs, created_at
             FROM osteotomies WHERE session = ? ORDER BY id",
        )
        .bind(session.to_string())
        .fetch_all(&self.reader)
        .await?;
        rows.into_iter().map(osteotomy).collect()
    }

    /// One osteotomy of a session, if it is there.
    ///
    /// # Errors
    /// [`StoreError::Database`], [`StoreError::Record`].
    pub async fn osteotomy(&self, session: SessionId, id: OsteotomyId) -> Result<Option<OsteotomyRecord>, StoreError> {
        Ok(self.osteotomies(session).await?.into_iter().find(|o| o.id == id))
    }

    /// Deletes an osteotomy and its plans. False when it was not there.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn delete_osteotomy(&self, session: SessionId, id: OsteotomyId) -> Result<bool, StoreError> {
        let Some(record) = self.osteotomy(session, id).await? else { return Ok(false) };
        let mut transaction = self.writer.begin().await?;
        sqlx::query(
            "INSERT OR IGNORE INTO tombstones (id, deleted_at)
             SELECT id, ?2 FROM plans WHERE osteotomy = ?1 UNION ALL SELECT ?1, ?2",
        )
        .bind(id.to_string())
        .bind(now_rfc3339())
        .execute(&mut *transaction)
        .await?;
        sqlx::query("DELETE FROM osteotomies WHERE id = ?").bind(id.to_string()).execute(&mut *transaction).await?;
        transaction.commit().await?;
        for blob in &record.blobs {
            self.blobs().delete(blob).await;
        }
        Ok(true)
    }

    /// Stores a plan.
    ///
    /// # Errors
    /// [`StoreError::SessionGone`] (or its osteotomy), [`StoreError::KeyTaken`], [`StoreError::Database`].
    pub async fn insert_plan(&self, record: &PlanRecord, answer: Option<&AnswerRecord>) -> Result<(), StoreError> {
        let mut transaction = self.writer.begin().await?;
        sqlx::query("INSERT INTO plans (id, session, osteotomy, document, created_at) VALUES (?, ?, ?, ?, ?)")
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

    /// Plans of a session, oldest first.
    ///
    /// # Errors
    /// [`StoreError::Database`], [`StoreError::Record`].
    pub async fn plans(&self, session: SessionId) -> Result<Vec<PlanRecord>, StoreError> {
        let rows = sqlx::query_as::<_, PlanRow>(
            "SELECT id, session, osteotomy, document, created_at FROM plans WHERE session = ? ORDER BY id",
        )
        .bind(session.to_string())
        .fetch_all(&self.reader)
        .await?;
        rows.into_iter().map(plan).collect()
    }

    /// One plan of a session, if it is there.
    ///
    /// # Errors
    /// [`StoreError::Database`], [`StoreError::Record`].
    pub async fn plan(&self, session: SessionId, id: PlanId) -> Result<Option<PlanRecord>, StoreError> {
        Ok(self.plans(session).await?.into_iter().find(|p| p.id == id))
    }

    /// Deletes a plan. False when it was not there.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn delete_plan(&self, session: SessionId, id: PlanId) -> Result<bool, StoreError> {
        let mut transaction = self.writer.begin().await?;
        let deleted = sqlx::query("DELETE FROM plans WHERE session = ? AND id = ?")
            .bind(session.to_string())
            .bind(id.to_string())
            .execute(&mut *transaction)
            .await?;
        if deleted.rows_affected() > 0 {
            sqlx::query("INSERT OR IGNORE INTO tombstones (id, deleted_at) VALUES (?, ?)")
                .bind(id.to_string())
                .bind(now_rfc3339())
                .execute(&mut *transaction)
                .await?;
        }
        transaction.commit().await?;
        Ok(deleted.rows_affected() > 0)
    }
}
