use sqlx::{Sqlite, Transaction};

use super::records::{to_i64, to_u64};
use super::{JobId, Store, StoreError};

/// One event of a job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EventRecord {
    /// Counts up from 1 within the job.
    pub seq: u64,
    /// `status`, `progress`, `step`, `warning` or `end`.
    pub kind: String,
    /// JSON.
    pub data: String,
}

pub(super) async fn append(
    transaction: &mut Transaction<'_, Sqlite>,
    job: JobId,
    kind: &str,
    data: &str,
) -> Result<(), StoreError> {
    sqlx::query(
        "INSERT INTO events (job, seq, kind, data)
         VALUES (?1, (SELECT coalesce(max(seq), 0) + 1 FROM events WHERE job = ?1), ?2, ?3)",
    )
    .bind(job.to_string())
    .bind(kind)
    .bind(data)
    .execute(&mut **transaction)
    .await?;
    Ok(())
}

impl Store {
    /// Events of a job after number `after`, in order.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn events(&self, job: JobId, after: u64) -> Result<Vec<EventRecord>, StoreError> {
        let rows: Vec<(i64, String, String)> =
            sqlx::query_as("SELECT seq, kind, data FROM events WHERE job = ? AND seq > ? ORDER BY seq")
                .bind(job.to_string())
                .bind(to_i64(after))
                .fetch_all(&self.reader)
                .await?;
        Ok(rows.into_iter().map(|(seq, kind, data)| EventRecord { seq: to_u64(seq), kind, data }).collect())
    }
}
