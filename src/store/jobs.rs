use std::str::FromStr;

use sqlx::{Row, Sqlite, Transaction};

use super::events::append;
use super::idempotency::remember;
use super::parts::{gone_if_orphan, session_of};
use super::records::{from_json, now_rfc3339, parse_id, to_i64, to_json, to_u32, to_u64};
use super::{AnswerRecord, BlobInfo, JobId, JobState, SessionId, Store, StoreError};

/// What a job makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JobKind {
    /// Skin and skull from a CT.
    Import,
    /// Distance fields.
    Field,
    /// Tissue mesh.
    Mesh,
    /// Deformed skin along a plan.
    Solve,
}

impl JobKind {
    /// Its name on the wire and in the database.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Import => "import",
            Self::Field => "field",
            Self::Mesh => "mesh",
            Self::Solve => "solve",
        }
    }
}

impl FromStr for JobKind {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        [Self::Import, Self::Field, Self::Mesh, Self::Solve]
            .into_iter()
            .find(|k| k.as_str() == text)
            .ok_or_else(|| format!("`{text}` is not a kind of job"))
    }
}

/// A job's row.
#[derive(Debug, Clone, PartialEq)]
pub struct JobRecord {
    /// Its place in the queue: lower ones run first.
    pub number: u64,
    /// Its id.
    pub id: JobId,
    /// Its session.
    pub session: SessionId,
    /// What it makes.
    pub kind: JobKind,
    /// Where it stands.
    pub state: JobState,
    /// Stage of the work, free text of one word.
    pub phase: String,
    /// Done share, 0 to 1.
    pub progress: f64,
    /// Steps that it will hand out.
    pub steps: u32,
    /// How often it was started.
    pub attempt: u32,
    /// What was asked for, JSON.
    pub request: String,
    /// Its report, JSON, once it has succeeded.
    pub report: Option<String>,
    /// Why it failed, JSON.
    pub fault: Option<String>,
    /// What a caller should know.
    pub warnings: Vec<String>,
    /// Blob of the skin at rest.
    pub rest_blob: Option<String>,
    /// Blob of the deformed volume, VTU.
    pub tissue_blob: Option<String>,
    /// RFC 3339.
    pub created_at: String,
    /// Start of the last attempt, RFC 3339.
    pub started_at: Option<String>,
    /// RFC 3339.
    pub finished_at: Option<String>,
}

/// Which jobs to list.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct JobFilter {
    /// Only of this session.
    pub session: Option<SessionId>,
    /// Only in this state.
    pub state: Option<JobState>,
    /// Only made before this one.
    pub before: Option<JobId>,
    /// At most so many.
    pub limit: u32,
}

/// A change of state and what is written with it.
#[derive(Debug, Clone, Default)]
pub(crate) struct JobChange {
    pub(crate) phase: Option<&'static str>,
    pub(crate) progress: Option<f64>,
    pub(crate) attempt_change: i64,
    pub(crate) report: Option<String>,
    pub(crate) fault: Option<String>,
    pub(crate) warnings: Vec<String>,
    pub(crate) tissue: Option<BlobInfo>,
    /// Kind and JSON of the events that tell of it.
    pub(crate) events: Vec<(&'static str, String)>,
}

/// What became of a job that was to be stored.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Insertion {
    /// It is stored.
    Stored,
    /// The session has a job that was asked for the same and has not ended.
    Twin(Box<JobRecord>),
    /// Too many jobs wait.
    Full,
}

fn record(row: &sqlx::sqlite::SqliteRow) -> Result<JobRecord, StoreError> {
    let text = |name: &str| row.try_get::<String, _>(name);
    Ok(JobRecord {
        number: to_u64(row.try_get("number")?),
        id: parse_id(&text("id")?)?,
        session: session_of(&text("session")?)?,
        kind: text("kind")?.parse().map_err(StoreError::record)?,
        state: text("state")?.parse().map_err(StoreError::record)?,
        phase: text("phase")?,
        progress: row.try_get("progress")?,
        steps: to_u32(row.try_get("steps")?),
        attempt: to_u32(row.try_get("attempt")?),
        request: text("request")?,
        report: row.try_get("report")?,
        fault: row.try_get("fault")?,
        warnings: from_json("warnings of a job", &text("warnings")?)?,
        rest_blob: row.try_get("rest_blob")?,
        tissue_blob: row.try_get("tissue_blob")?,
        created_at: text("created_at")?,
        started_at: row.try_get("started_at")?,
        finished_at: row.try_get("finished_at")?,
    })
}

impl Store {
    /// Stores an accepted job with its first event, unless the session has its twin or `max_waiting` jobs wait already.
    /// `answer` makes what a repeated request gets, from the job or its twin. `stopping` is no twin: it is about to end.
    ///
    /// # Errors
    /// [`StoreError::SessionGone`], [`StoreError::KeyTaken`], [`StoreError::Database`].
    pub(crate) async fn insert_job(
        &self,
        job: &JobRecord,
        max_waiting: u32,
        event: &str,
        stopping: Option<JobId>,
        answer: impl FnOnce(&JobRecord) -> Option<AnswerRecord>,
    ) -> Result<Insertion, StoreError> {
        let mut transaction = self.writer.begin().await?;
        let twin = sqlx::query(
            "SELECT * FROM jobs WHERE session = ?1 AND kind = ?2 AND request = ?3
             AND state IN ('accepted', 'running', 'interrupted') AND (?4 IS NULL OR id <> ?4) ORDER BY number LIMIT 1",
        )
        .bind(job.session.to_string())
        .bind(job.kind.as_str())
        .bind(&job.request)
        .bind(stopping.map(|id| id.to_string()))
        .fetch_optional(&mut *transaction)
        .await?;
        if let Some(twin) = twin.as_ref().map(record).transpose()? {
            remember(&mut transaction, answer(&twin).as_ref()).await?;
            transaction.commit().await?;
            return Ok(Insertion::Twin(Box::new(twin)));
        }
        let waiting: i64 = sqlx::query_scalar("SELECT count(*) FROM jobs WHERE state = 'accepted'")
            .fetch_one(&mut *transaction)
            .await?;
        if waiting >= i64::from(max_waiting) {
            return Ok(Insertion::Full);
        }
        sqlx::query(
            "INSERT INTO jobs (id, session, kind, state, phase, progress, steps, attempt, request, warnings, bytes, created_at)
             VALUES (?, ?, ?, ?, ?, 0, ?, 0, ?, '[]', 0, ?)",
        )
        .bind(job.id.to_string())
        .bind(job.session.to_string())
        .bind(job.kind.as_str())
        .bind(job.state.as_str())
        .bind(&job.phase)
        .bind(i64::from(job.steps))
        .bind(&job.request)
        .bind(&job.created_at)
        .execute(&mut *transaction)
        .await
        .map_err(gone_if_orphan)?;
        append(&mut transaction, job.id, "status", event).await?;
        remember(&mut transaction, answer(job).as_ref()).await?;
        transaction.commit().await?;
        Ok(Insertion::Stored)
    }

    /// A job, if it is there.
    ///
    /// # Errors
    /// [`StoreError::Database`], [`StoreError::Record`].
    pub async fn job(&self, id: JobId) -> Result<Option<JobRecord>, StoreError> {
        sqlx::query("SELECT * FROM jobs WHERE id = ?")
            .bind(id.to_string())
            .fetch_optional(&self.reader)
            .await?
            .as_ref()
            .map(record)
            .transpose()
    }

    /// Jobs, newest first.
    ///
    /// # Errors
    /// [`StoreError::Database`], [`StoreError::Record`].
    pub async fn jobs(&self, filter: &JobFilter) -> Result<Vec<JobRecord>, StoreError> {
        sqlx::query(
            "SELECT * FROM jobs WHERE (?1 IS NULL OR session = ?1) AND (?2 IS NULL OR state = ?2)
             AND (?3 IS NULL OR id < ?3) ORDER BY id DESC LIMIT ?4",
        )
        .bind(filter.session.map(|s| s.to_string()))
        .bind(filter.state.map(JobState::as_str))
        .bind(filter.before.map(|b| b.to_string()))
        .bind(i64::from(filter.limit))
        .fetch_all(&self.reader)
        .await?
        .iter()
        .map(record)
        .collect()
    }

    /// The accepted job that has waited longest.
    ///
    /// # Errors
    /// [`StoreError::Database`], [`StoreError::Record`].
    pub async fn next_job(&self) -> Result<Option<JobRecord>, StoreError> {
        sqlx::query("SELECT * FROM jobs WHERE state = 'accepted' ORDER BY number LIMIT 1")
            .fetch_optional(&self.reader)
            .await?
            .as_ref()
            .map(record)
            .transpose()
    }

    /// How many accepted jobs wait, and how many of them are before `number`.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn waiting(&self, number: u64) -> Result<(u32, u32), StoreError> {
        let (all, before): (i64, i64) =
            sqlx::query_as("SELECT count(*), coalesce(sum(number < ?), 0) FROM jobs WHERE state = 'accepted'")
                .bind(to_i64(number))
                .fetch_one(&self.reader)
                .await?;
        Ok((to_u32(all), to_u32(before)))
    }

    /// Moves a job from one state to another, with its events, if it is in `from`. False when it is not.
    pub(crate) async fn change_job(
        &self,
        id: JobId,
        from: JobState,
        to: JobState,
        change: &JobChange,
    ) -> Result<bool, StoreError> {
        let mut transaction = self.writer.begin().await?;
        let now = now_rfc3339();
        let changed = sqlx::query(
            "UPDATE jobs SET state = ?3, phase = coalesce(?4, phase), attempt = attempt + ?5,
             report = coalesce(?6, report), fault = coalesce(?7, fault),
             tissue_blob = coalesce(?8, tissue_blob), bytes = bytes + ?9,
             progress = CASE ?3 WHEN 'succeeded' THEN 1 WHEN 'accepted' THEN 0 ELSE coalesce(?12, progress) END,
             started_at = CASE ?3 WHEN 'running' THEN ?10 ELSE started_at END,
             finished_at = CASE WHEN ?11 THEN ?10 ELSE finished_at END
             WHERE id = ?1 AND state = ?2",
        )
        .bind(id.to_string())
        .bind(from.as_str())
        .bind(to.as_str())
        .bind(change.phase)
        .bind(change.attempt_change)
        .bind(&change.report)
        .bind(&change.fault)
        .bind(change.tissue.as_ref().map(|t| t.key.clone()))
        .bind(change.tissue.as_ref().map_or(0, |t| to_i64(t.bytes)))
        .bind(now)
        .bind(to.has_ended())
        .bind(change.progress)
        .execute(&mut *transaction)
        .await?;
        if changed.rows_affected() == 0 {
            return Ok(false);
        }
        add_warnings(&mut transaction, id, &change.warnings).await?;
        for (kind, data) in &change.events {
            append(&mut transaction, id, kind, data).await?;
        }
        transaction.commit().await?;
        Ok(true)
    }

    /// Records how far a running job is, with an event. False when the job is not running any more.
    pub(crate) async fn record_progress(
        &self,
        id: JobId,
        phase: &str,
        progress: f64,
        event: &str,
    ) -> Result<bool, StoreError> {
        let mut transaction = self.writer.begin().await?;
        let changed = sqlx::query("UPDATE jobs SET phase = ?, progress = ? WHERE id = ? AND state = 'running'")
            .bind(phase)
            .bind(progress)
            .bind(id.to_string())
            .execute(&mut *transaction)
            .await?;
        if changed.rows_affected() == 0 {
            return Ok(false);
        }
        append(&mut transaction, id, "progress", event).await?;
        transaction.commit().await?;
        Ok(true)
    }

    /// Names the skin at rest of a job; the blob that it replaces is removed.
    pub(crate) async fn set_rest(&self, id: JobId, rest: &BlobInfo) -> Result<(), StoreError> {
        let old = self.job(id).await?.ok_or(StoreError::SessionGone)?.rest_blob;
        sqlx::query("UPDATE jobs SET rest_blob = ?, bytes = ? WHERE id = ?")
            .bind(&rest.key)
            .bind(to_i64(rest.bytes))
            .bind(id.to_string())
            .execute(&self.writer)
            .await?;
        if let Some(old) = old {
            self.blobs().delete(&old).await;
        }
        Ok(())
    }
}

async fn add_warnings(transaction: &mut Transaction<'_, Sqlite>, id: JobId, new: &[String]) -> Result<(), StoreError> {
    if new.is_empty() {
        return Ok(());
    }
    let text: String = sqlx::query_scalar("SELECT warnings FROM jobs WHERE id = ?")
        .bind(id.to_string())
        .fetch_one(&mut **transaction)
        .await?;
    let mut warnings: Vec<String> = from_json("warnings of a job", &text)?;
    for warning in new {
        if !warnings.contains(warning) {
            warnings.push(warning.clone());
        }
    }
    sqlx::query("UPDATE jobs SET warnings = ? WHERE id = ?")
        .bind(to_json("warnings of a job", &warnings)?)
        .bind(id.to_string())
        .execute(&mut **transaction)
        .await?;
    Ok(())
}
