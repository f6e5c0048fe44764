use super::events::append;
use super::records::{to_i64, to_u32};
use super::{BlobInfo, JobId, Store, StoreError};

/// One finished step of a job.
#[derive(Debug, Clone, PartialEq)]
pub struct StepRecord {
    /// Number, 1 to n.
    pub k: u32,
    /// Path parameter, 0 to 1.
    pub t: f64,
    /// Solver's report, JSON.
    pub document: String,
    /// Error statistics, JSON, where there is something to compare with.
    pub error: Option<String>,
    /// Blob of the frame.
    pub blob: String,
    /// SHA-256 of the frame.
    pub sha256: String,
}

type Row = (i64, f64, String, Option<String>, String, String);

impl Store {
    /// Makes a step visible: its row and its events in one transaction, after the frame is on disk.
    ///
    /// A step that an earlier attempt left is replaced.
    ///
    /// # Errors
    /// [`StoreError::SessionGone`] when the job is not there or not running any more, [`StoreError::Database`].
    pub(crate) async fn commit_step(
        &self,
        job: JobId,
        step: &StepRecord,
        frame: &BlobInfo,
        events: &[(&'static str, String)],
    ) -> Result<(), StoreError> {
        let mut transaction = self.writer.begin().await?;
        let running: Option<i64> = sqlx::query_scalar("SELECT 1 FROM jobs WHERE id = ? AND state = 'running'")
            .bind(job.to_string())
            .fetch_optional(&mut *transaction)
            .await?;
        if running.is_none() {
            return Err(StoreError::SessionGone);
        }
        let old: Option<String> = sqlx::query_scalar("SELECT blob FROM steps WHERE job = ? AND k = ?")
            .bind(job.to_string())
            .bind(i64::from(step.k))
            .fetch_optional(&mut *transaction)
            .await?;
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
        .bind(to_i64(frame.bytes))
        .execute(&mut *transaction)
        .await?;
        for (kind, data) in events {
            append(&mut transaction, job, kind, data).await?;
        }
        transaction.commit().await?;
        if let Some(old) = old.filter(|old| *old != step.blob) {
            self.blobs().delete(&old).await;
        }
        Ok(())
    }

    /// Finished steps of a job, in order.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn steps(&self, job: JobId) -> Result<Vec<StepRecord>, StoreError> {
        let rows: Vec<Row> =
            sqlx::query_as("SELECT k, t, document, error, blob, sha256 FROM steps WHERE job = ? ORDER BY k")
                .bind(job.to_string())
                .fetch_all(&self.reader)
                .await?;
        let record =
            |(k, t, document, error, blob, sha256)| StepRecord { k: to_u32(k), t, document, error, blob, sha256 };
        Ok(rows.into_iter().map(record).collect())
    }

    /// One finished step, if it is there.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn step(&self, job: JobId, k: u32) -> Result<Option<StepRecord>, StoreError> {
        Ok(self.steps(job).await?.into_iter().find(|s| s.k == k))
    }
}
