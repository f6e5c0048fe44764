//! Rows in one SQLite database: write-ahead log, every commit synced.

mod anchor;
mod answers;
mod contents;
mod events;
mod format;
mod jobs;
mod parts;
mod plans;
mod queue;
mod sessions;
mod steps;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::Duration;

use async_trait::async_trait;
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{Connection, SqlitePool};

pub(super) use format::DATABASE;

use super::{
    AnswerRecord, BlobInfo, EventRecord, Insertion, JobChange, JobFilter, JobId, JobRecord, JobState, Lane, MetaStore,
    NewJob, OsteotomyId, OsteotomyRecord, Owner, PartKind, PartRecord, PlanId, PlanRecord, Remembered, SessionContents,
    SessionId, SessionRecord, StepRecord, StepWritten, StoreError, TenantId,
};

type Result<T> = std::result::Result<T, StoreError>;

/// Readers beside the one writer.
const READERS: u32 = 4;

/// The database of one data directory.
#[derive(Debug)]
pub(super) struct SqliteMeta {
    /// One connection: SQLite has one writer, so nobody meets a busy database.
    writer: SqlitePool,
    reader: SqlitePool,
}

impl SqliteMeta {
    /// Opens or creates the database in `directory` and brings it to the present format.
    pub(super) async fn open(directory: &Path) -> Result<Self> {
        let options = options(directory).create_if_missing(true);
        let writer = one_writer().connect_with(options.clone()).await.map_err(format::no_database)?;
        format::prepare(&writer).await?;
        // A connection to a file does not break while it waits: asking it first would double the time of a read.
        let readers = SqlitePoolOptions::new().max_connections(READERS).test_before_acquire(false);
        let reader = readers.connect_with(options).await?;
        Ok(Self { writer, reader })
    }

    /// Opens a database of the present format beside the process that serves it.
    pub(super) async fn open_beside(directory: &Path) -> Result<Self> {
        let pool = one_writer().connect_with(options(directory)).await.map_err(format::no_database)?;
        format::check_version(&pool).await?;
        Ok(Self { writer: pool.clone(), reader: pool })
    }

    /// Writes a copy of the database as it is at one moment to `file`, which must not be there.
    pub(super) async fn copy_to(&self, file: &Path) -> Result<()> {
        let file = file.to_str().ok_or_else(|| StoreError::record("the path of the copy is not UTF-8"))?;
        sqlx::query("VACUUM INTO ?").bind(file).execute(&self.reader).await?;
        Ok(())
    }

    /// Forgets the end of an audit log that is elsewhere.
    pub(super) async fn clear_audit_anchor(&self) -> Result<()> {
        anchor::clear(&self.writer).await
    }

    #[cfg(test)]
    pub(super) fn writer(&self) -> &SqlitePool {
        &self.writer
    }
}

/// A connection that is still in a transaction when it is given back is closed: where the disk is full SQLite may have rolled back by
/// itself, the driver does not learn it, and what is "committed" from then on would lie in a transaction that never ends.
fn one_writer() -> SqlitePoolOptions {
    SqlitePoolOptions::new().max_connections(1).after_release(|connection, _| {
        Box::pin(async move {
            // A roll-back that is under way is done before the answer.
            connection.ping().await?;
            Ok(!connection.is_in_transaction())
        })
    })
}

fn options(directory: &Path) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(directory.join(DATABASE))
        .journal_mode(SqliteJournalMode::Wal)
        .synchronous(SqliteSynchronous::Full)
        .foreign_keys(true)
        // What is deleted is overwritten: rows hold paths and reports of patients.
        .pragma("secure_delete", "ON")
        .busy_timeout(Duration::from_secs(10))
}

/// Removes the database of a directory.
pub(super) fn remove(directory: &Path) -> Result<()> {
    for suffix in ["", "-wal", "-shm"] {
        match std::fs::remove_file(directory.join(format!("{DATABASE}{suffix}"))) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error.into()),
            _ => {}
        }
    }
    Ok(())
}

/// A row whose session is gone breaks the foreign key.
fn gone_if_orphan(error: sqlx::Error) -> StoreError {
    let orphan = error.as_database_error().is_some_and(sqlx::error::DatabaseError::is_foreign_key_violation);
    if orphan { StoreError::SessionGone } else { StoreError::Database(error) }
}

#[async_trait]
impl MetaStore for SqliteMeta {
    async fn insert_session(&self, session: &SessionRecord, answer: Option<&AnswerRecord>) -> Result<()> {
        sessions::insert(&self.writer, session, answer).await
    }

    async fn session(&self, id: SessionId) -> Result<Option<SessionRecord>> {
        sessions::one(&self.reader, id).await
    }

    async fn sessions(
        &self,
        tenant: Option<&TenantId>,
        before: Option<SessionId>,
        limit: u32,
    ) -> Result<Vec<SessionRecord>> {
        sessions::page(&self.reader, tenant, before, limit).await
    }

    async fn delete_session(&self, id: SessionId) -> Result<Option<Vec<String>>> {
        sessions::delete(&self.writer, id).await
    }

    async fn idle_sessions(&self, since: &str) -> Result<Vec<SessionRecord>> {
        sessions::idle(&self.reader, since).await
    }

    async fn last_used(&self, id: SessionId) -> Result<Option<String>> {
        sessions::last_used(&self.reader, id).await
    }

    async fn session_bytes(&self, id: SessionId) -> Result<u64> {
        let mut connection = self.reader.acquire().await?;
        sessions::bytes(&mut connection, id).await
    }

    async fn contents(&self, sessions: &[SessionId], jobs: u32) -> Result<BTreeMap<SessionId, SessionContents>> {
        contents::of(&self.reader, sessions, jobs).await
    }

    async fn owner(&self, id: &str) -> Result<Option<Owner>> {
        sessions::owner(&self.reader, id).await
    }

    async fn is_deleted(&self, id: &str) -> Result<bool> {
        sessions::is_deleted(&self.reader, id).await
    }

    async fn remembered(&self, tenant: &TenantId, key: &str, request_sha256: &str) -> Result<Remembered> {
        answers::remembered(&self.reader, tenant, key, request_sha256).await
    }

    async fn forget(&self, answers: &str, tombstones: &str) -> Result<()> {
        answers::forget(&self.writer, answers, tombstones).await
    }

    async fn put_parts(&self, session: SessionId, parts: &[PartRecord], quota: u64) -> Result<Vec<String>> {
        parts::put(&self.writer, session, parts, quota).await
    }

    async fn delete_part(&self, session: SessionId, kind: PartKind) -> Result<Option<Option<String>>> {
        parts::delete(&self.writer, session, kind).await
    }

    async fn parts(&self, session: SessionId) -> Result<Vec<PartRecord>> {
        parts::all(&self.reader, session).await
    }

    async fn insert_osteotomy(
        &self,
        record: &OsteotomyRecord,
        answer: Option<&AnswerRecord>,
        quota: u64,
    ) -> Result<()> {
        plans::insert_osteotomy(&self.writer, record, answer, quota).await
    }

    async fn osteotomies(&self, session: SessionId) -> Result<Vec<OsteotomyRecord>> {
        plans::osteotomies(&self.reader, session).await
    }

    async fn delete_osteotomy(&self, session: SessionId, id: OsteotomyId) -> Result<Option<Vec<String>>> {
        plans::delete_osteotomy(&self.writer, session, id).await
    }

    async fn insert_plan(&self, record: &PlanRecord, answer: Option<&AnswerRecord>) -> Result<()> {
        plans::insert_plan(&self.writer, record, answer).await
    }

    async fn plans(&self, session: SessionId) -> Result<Vec<PlanRecord>> {
        plans::plans(&self.reader, session).await
    }

    async fn delete_plan(&self, session: SessionId, id: PlanId) -> Result<bool> {
        plans::delete_plan(&self.writer, session, id).await
    }

    async fn insert_job(&self, new: &NewJob<'_>) -> Result<Insertion> {
        queue::insert(&self.writer, new).await
    }

    async fn job(&self, id: JobId) -> Result<Option<JobRecord>> {
        jobs::one(&self.reader, id).await
    }

    async fn jobs(&self, filter: &JobFilter) -> Result<Vec<JobRecord>> {
        jobs::page(&self.reader, filter).await
    }

    async fn queue(&self, lane: Lane) -> Result<Vec<JobId>> {
        queue::in_order(&self.reader, lane).await
    }

    async fn claim_job(
        &self,
        lane: Lane,
        to: JobState,
        change: &(dyn for<'a> Fn(&'a JobRecord) -> JobChange + Send + Sync),
    ) -> Result<Option<JobRecord>> {
        queue::claim(&self.writer, lane, to, change).await
    }

    async fn change_job(
        &self,
        id: JobId,
        fence: u64,
        from: JobState,
        to: JobState,
        change: &JobChange,
        quota: u64,
    ) -> Result<bool> {
        jobs::change(&self.writer, id, fence, from, to, change, quota).await
    }

    async fn request_cancel(&self, id: JobId) -> Result<bool> {
        jobs::request_cancel(&self.writer, id).await
    }

    async fn record_progress(&self, id: JobId, fence: u64, phase: &str, progress: f64, event: &str) -> Result<bool> {
        jobs::record_progress(&self.writer, id, fence, phase, progress, event).await
    }

    async fn set_rest(&self, id: JobId, fence: u64, rest: &BlobInfo, quota: u64) -> Result<Option<String>> {
        jobs::set_rest(&self.writer, id, fence, rest, quota).await
    }

    async fn commit_step(
        &self,
        job: JobId,
        fence: u64,
        step: &StepRecord,
        events: &[(&'static str, String)],
        quota: u64,
    ) -> Result<StepWritten> {
        steps::commit(&self.writer, job, fence, step, events, quota).await
    }

    async fn steps(&self, jobs: &[JobId]) -> Result<BTreeMap<JobId, Vec<StepRecord>>> {
        steps::of(&self.reader, jobs).await
    }

    async fn events(&self, job: JobId, after: u64) -> Result<Vec<EventRecord>> {
        events::after(&self.reader, job, after).await
    }

    async fn prune_events(&self, ended_before: &str) -> Result<u64> {
        events::prune(&self.writer, ended_before).await
    }

    async fn drop_comparisons(&self, ended_before: &str) -> Result<Vec<String>> {
        jobs::drop_comparisons(&self.writer, ended_before).await
    }

    async fn set_audit_anchor(&self, chain: &str, at: &str) -> Result<()> {
        anchor::set(&self.writer, chain, at).await
    }

    async fn audit_anchor(&self) -> Result<Option<(String, String)>> {
        anchor::get(&self.reader).await
    }

    async fn named_blobs(&self) -> Result<BTreeSet<String>> {
        sessions::named_blobs(&self.reader).await
    }

    async fn check(&self) -> Result<()> {
        sqlx::query("SELECT 1").execute(&self.reader).await?;
        let transaction = self.writer.begin().await?;
        transaction.rollback().await?;
        Ok(())
    }

    async fn close(&self) {
        self.reader.close().await;
        self.writer.close().await;
    }
}

#[cfg(test)]
mod tests {
    use super::super::conformance::session;
    use super::*;

    #[tokio::test]
    async fn a_connection_that_met_a_full_disk_is_not_used_again() {
        let directory = tempfile::tempdir().unwrap();
        let meta = SqliteMeta::open(directory.path()).await.unwrap();
        let kept = session("a");
        meta.insert_session(&kept, None).await.unwrap();
        sqlx::query("PRAGMA max_page_count = 1").execute(&meta.writer).await.unwrap();
        let mut refused = 0;
        for _ in 0..400 {
            let tried = session("a");
            match meta.insert_session(&tried, None).await {
                Ok(()) => assert_eq!(meta.session(tried.id).await.unwrap(), Some(tried)),
                Err(error) => {
                    assert!(error.is_disk_full(), "{error:?}");
                    assert_eq!(meta.session(tried.id).await.unwrap(), None);
                    refused += 1;
                }
            }
        }
        // The limit goes with the connection.
        assert_eq!(refused, 1);
        assert_eq!(meta.session(kept.id).await.unwrap(), Some(kept));
    }
}
