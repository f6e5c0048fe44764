mod jobs;

use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use object_store::ObjectStore;

use super::memory::MemoryMeta;
use super::place::Places;
use super::postgres::PostgresMeta;
use super::records::{now_rfc3339, rfc3339_before};
use super::sqlite::{self, SqliteMeta};
use super::{
    AnswerRecord, Blobs, MetaStore, OsteotomyId, OsteotomyRecord, Owner, PartKind, PartRecord, PlanId, PlanRecord,
    Remembered, SessionContents, SessionId, SessionRecord, StoreError, TenantId,
};

/// Directory of the large values.
pub(super) const BLOBS: &str = "blobs";
/// File whose lock says that a process has the directory.
pub(super) const LOCK: &str = "lock";

/// Files younger than this may belong to a request that is under way.
const UNDER_WAY: Duration = Duration::from_secs(2 * 3600);

type Result<T> = std::result::Result<T, StoreError>;

/// Rows and large values together: a row names a blob only after the blob is whole and synced, and a blob that no row names
/// any more is removed. Clones share it.
#[derive(Debug, Clone)]
pub struct Store {
    meta: Arc<dyn MetaStore>,
    blobs: Blobs,
    quota: u64,
    /// Name of the audit log beside it.
    log: Arc<str>,
    /// Held open for its lock.
    _lock: Option<Arc<File>>,
}

impl Store {
    /// Opens or creates the store in `directory`, and sweeps files that no row names (left by a crash).
    ///
    /// # Errors
    /// [`StoreError::InUse`] when another process has it open, [`StoreError::Newer`] and [`StoreError::Foreign`] when another
    /// version or program wrote it, otherwise whatever the disk or the database says.
    pub async fn open(directory: &Path) -> Result<Self> {
        Self::open_at(directory, &Places::default()).await
    }

    /// The same with rows or large values in other places. The directory stays this process's own: it has the audit log, and what has
    /// no other place.
    ///
    /// # Errors
    /// As [`Store::open`]; [`StoreError::Unreachable`], [`StoreError::ForeignTables`], [`StoreError::Bucket`].
    pub async fn open_at(directory: &Path, places: &Places) -> Result<Self> {
        create_private(directory)?;
        let lock = lock(directory)?;
        let blobs = match &places.blobs {
            Some(bucket) => Blobs::over(bucket.open()?),
            None => Blobs::in_directory(&directory.join(BLOBS))?,
        };
        let (meta, log): (Arc<dyn MetaStore>, _) = match &places.database {
            Some(database) => (Arc::new(PostgresMeta::open(database.options()).await?), log_name(directory)?),
            None => (Arc::new(SqliteMeta::open(directory).await?), LOCAL_LOG.to_owned()),
        };
        let store = Self { meta, blobs, quota: u64::MAX, log: log.into(), _lock: Some(Arc::new(lock)) };
        // Elsewhere another process may be about to name what it has stored.
        if *places == Places::default() {
            let swept = store.sweep(Duration::ZERO).await?;
            if swept > 0 {
                tracing::info!(files = swept, "removed files that no record names");
            }
        }
        Ok(store)
    }

    /// A store that ends with the process.
    #[must_use]
    pub fn in_memory() -> Self {
        let (meta, blobs) = (Arc::new(MemoryMeta::default()), Blobs::in_memory());
        Self { meta, blobs, quota: u64::MAX, log: LOCAL_LOG.into(), _lock: None }
    }

    /// The same rows with large values in another place, such as an S3-compatible store.
    #[must_use]
    pub fn with_objects(self, objects: Arc<dyn ObjectStore>) -> Self {
        Self { blobs: Blobs::over(objects), ..self }
    }

    /// The same store that lets a session have at most `bytes`.
    #[must_use]
    pub fn with_quota(self, bytes: u64) -> Self {
        Self { quota: bytes, ..self }
    }

    /// Removes what a store left in `directory`, of whatever version; other files stay.
    ///
    /// # Errors
    /// [`StoreError::InUse`] when a process has it open, [`StoreError::Io`].
    pub fn erase(directory: &Path) -> Result<()> {
        create_private(directory)?;
        let _held = lock(directory)?;
        // The blobs last: rows without their files would be refused, files without rows are swept.
        sqlite::remove(directory)?;
        match std::fs::remove_dir_all(directory.join(BLOBS)) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error.into()),
            _ => Ok(()),
        }
    }

    /// Large immutable values.
    #[must_use]
    pub fn blobs(&self) -> &Blobs {
        &self.blobs
    }

    /// Bytes that a session may have.
    #[must_use]
    pub fn quota(&self) -> u64 {
        self.quota
    }

    /// Bytes that a session may still store.
    ///
    /// # Errors
    /// [`StoreError`]; so for all that follow.
    pub async fn room(&self, session: SessionId) -> Result<u64> {
        Ok(self.quota.saturating_sub(self.meta.session_bytes(session).await?))
    }

    async fn remove_blobs(&self, keys: Vec<String>) {
        for key in keys {
            self.blobs.delete(&key).await;
        }
    }

    /// Removes blobs that rows were to name and do not.
    async fn remove_refused(&self, error: &StoreError, keys: Vec<String>) {
        if !error.may_be_written() {
            self.remove_blobs(keys).await;
        }
    }

    // ---- sessions ----

    /// Stores a new session together with the answer that a repeated request gets.
    ///
    /// # Errors
    /// [`StoreError::KeyTaken`] when the idempotency key was used meanwhile.
    pub async fn insert_session(&self, session: &SessionRecord, answer: Option<&AnswerRecord>) -> Result<()> {
        self.meta.insert_session(session, answer).await
    }

    /// A session, if it is there.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn session(&self, id: SessionId) -> Result<Option<SessionRecord>> {
        self.meta.session(id).await
    }

    /// Sessions of a tenant (of all when `None`), newest first, from those made before `before` on.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn sessions(
        &self,
        tenant: Option<&TenantId>,
        before: Option<SessionId>,
        limit: u32,
    ) -> Result<Vec<SessionRecord>> {
        self.meta.sessions(tenant, before, limit).await
    }

    /// Deletes a session with everything in it, and jobs of other sessions that read it. False when it was not there.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn delete_session(&self, id: SessionId) -> Result<bool> {
        let Some(elsewhere) = self.meta.delete_session(id).await? else { return Ok(false) };
        self.blobs.delete_session(id).await?;
        self.remove_blobs(elsewhere).await;
        Ok(true)
    }

    /// Sessions in which nothing was made or changed for `idle` and no job waits or runs.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn idle_sessions(&self, idle: Duration) -> Result<Vec<SessionRecord>> {
        self.meta.idle_sessions(&rfc3339_before(idle)).await
    }

    /// When something was last made or changed in a session, RFC 3339.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn last_used(&self, id: SessionId) -> Result<Option<String>> {
        self.meta.last_used(id).await
    }

    /// Bytes stored for a session.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn session_bytes(&self, id: SessionId) -> Result<u64> {
        self.meta.session_bytes(id).await
    }

    /// What sessions hold, with at most `jobs` jobs each; nothing for those that are not there.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn contents(&self, sessions: &[SessionId], jobs: u32) -> Result<BTreeMap<SessionId, SessionContents>> {
        self.meta.contents(sessions, jobs).await
    }

    /// Whose a session or job is, or was.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn owner(&self, id: &str) -> Result<Option<Owner>> {
        self.meta.owner(id).await
    }

    /// Whether something with this id was there and was deleted.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn is_deleted(&self, id: &str) -> Result<bool> {
        self.meta.is_deleted(id).await
    }

    // ---- answers ----

    /// What is known of a tenant's idempotency key.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn remembered(&self, tenant: &TenantId, key: &str, request_sha256: &str) -> Result<Remembered> {
        self.meta.remembered(tenant, key, request_sha256).await
    }

    /// Forgets answers older than `age` and tombstones older than ten times that.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn forget_old_answers(&self, age: Duration) -> Result<()> {
        self.meta.forget(&rfc3339_before(age), &rfc3339_before(age.saturating_mul(10))).await
    }

    // ---- parts ----

    /// Stores parts in one transaction, each in place of the one before, and removes the blobs that they replace; on
    /// failure those that they name.
    ///
    /// # Errors
    /// [`StoreError::SessionGone`] when the session is not there, [`StoreError::QuotaFull`].
    pub async fn put_parts(&self, session: SessionId, parts: &[PartRecord]) -> Result<()> {
        match self.meta.put_parts(session, parts, self.quota).await {
            Ok(replaced) => {
                self.remove_blobs(replaced).await;
                Ok(())
            }
            Err(error) => {
                self.remove_refused(&error, parts.iter().filter_map(|p| p.blob.clone()).collect()).await;
                Err(error)
            }
        }
    }

    /// Removes a part; true when it was there.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn delete_part(&self, session: SessionId, kind: PartKind) -> Result<bool> {
        let Some(blob) = self.meta.delete_part(session, kind).await? else { return Ok(false) };
        self.remove_blobs(blob.into_iter().collect()).await;
        Ok(true)
    }

    /// All parts of a session.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn parts(&self, session: SessionId) -> Result<Vec<PartRecord>> {
        self.meta.parts(session).await
    }

    /// One part of a session, if it is there.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn part(&self, session: SessionId, kind: PartKind) -> Result<Option<PartRecord>> {
        Ok(self.parts(session).await?.into_iter().find(|p| p.kind == kind))
    }

    // ---- osteotomies and plans ----

    /// Stores an osteotomy; on failure the blobs that it names are removed.
    ///
    /// # Errors
    /// [`StoreError::SessionGone`], [`StoreError::KeyTaken`], [`StoreError::QuotaFull`].
    pub async fn insert_osteotomy(&self, record: &OsteotomyRecord, answer: Option<&AnswerRecord>) -> Result<()> {
        let inserted = self.meta.insert_osteotomy(record, answer, self.quota).await;
        if let Err(error) = &inserted {
            self.remove_refused(error, record.blobs.clone()).await;
        }
        inserted
    }

    /// Osteotomies of a session, oldest first.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn osteotomies(&self, session: SessionId) -> Result<Vec<OsteotomyRecord>> {
        self.meta.osteotomies(session).await
    }

    /// One osteotomy of a session, if it is there.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn osteotomy(&self, session: SessionId, id: OsteotomyId) -> Result<Option<OsteotomyRecord>> {
        Ok(self.osteotomies(session).await?.into_iter().find(|o| o.id == id))
    }

    /// Deletes an osteotomy and its plans. False when it was not there.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn delete_osteotomy(&self, session: SessionId, id: OsteotomyId) -> Result<bool> {
        let Some(blobs) = self.meta.delete_osteotomy(session, id).await? else { return Ok(false) };
        self.remove_blobs(blobs).await;
        Ok(true)
    }

    /// Stores a plan.
    ///
    /// # Errors
    /// [`StoreError::SessionGone`] (or its osteotomy), [`StoreError::KeyTaken`].
    pub async fn insert_plan(&self, record: &PlanRecord, answer: Option<&AnswerRecord>) -> Result<()> {
        self.meta.insert_plan(record, answer).await
    }

    /// Plans of a session, oldest first.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn plans(&self, session: SessionId) -> Result<Vec<PlanRecord>> {
        self.meta.plans(session).await
    }

    /// One plan of a session, if it is there.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn plan(&self, session: SessionId, id: PlanId) -> Result<Option<PlanRecord>> {
        Ok(self.plans(session).await?.into_iter().find(|p| p.id == id))
    }

    /// Deletes a plan. False when it was not there.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn delete_plan(&self, session: SessionId, id: PlanId) -> Result<bool> {
        self.meta.delete_plan(session, id).await
    }

    // ---- jobs ----

    /// Removes blobs and unfinished uploads that no row names and that are too old to be under way: their number.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn sweep_old(&self) -> Result<usize> {
        self.sweep(UNDER_WAY).await
    }

    async fn sweep(&self, older_than: Duration) -> Result<usize> {
        // Listed before the rows are read: what is stored and named in between is not among the files.
        let found = self.blobs.older_than(older_than).await?;
        if found.is_empty() {
            return Ok(0);
        }
        let named = self.meta.named_blobs().await?;
        let unnamed: Vec<String> = found.into_iter().filter(|key| !named.contains(key)).collect();
        self.blobs.remove_files(&unnamed).await
    }

    /// Notes where the audit log ends, so that a tail that is cut off shows.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn set_audit_anchor(&self, chain: &str) -> Result<()> {
        self.meta.set_audit_anchor(&self.log, chain, &now_rfc3339()).await
    }

    /// The noted end of the audit log, and when it was noted.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn audit_anchor(&self) -> Result<Option<(String, String)>> {
        self.meta.audit_anchor(&self.log).await
    }

    /// Whether the database answers and can be written.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn check(&self) -> Result<()> {
        self.meta.check().await
    }

    /// Closes all connections after what is under way.
    pub async fn close(&self) {
        self.meta.close().await;
    }
}

/// The audit log of a store in its own directory.
pub(super) const LOCAL_LOG: &str = "local";
/// File with the name of the audit log beside it, by which a shared database tells it from others.
const LOG_NAME: &str = "audit-log";

/// The name of the audit log in a directory, made when there is none.
pub(super) fn log_name(directory: &Path) -> std::io::Result<String> {
    let file = directory.join(LOG_NAME);
    match std::fs::read_to_string(&file) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            let (name, fresh) = (uuid::Uuid::now_v7().to_string(), file.with_extension("new"));
            std::fs::write(&fresh, &name)?;
            std::fs::rename(fresh, file)?;
            Ok(name)
        }
        name => name,
    }
}

pub(super) fn lock(directory: &Path) -> Result<File> {
    let lock = File::create(directory.join(LOCK))?;
    match lock.try_lock() {
        Ok(()) => Ok(lock),
        Err(TryLockError::WouldBlock) => Err(StoreError::InUse),
        Err(TryLockError::Error(error)) => Err(StoreError::Io(error)),
    }
}

/// Makes the directory, for its owner only.
pub(super) fn create_private(directory: &Path) -> std::io::Result<()> {
    let mut builder = std::fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(directory)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::sqlite::DATABASE;

    async fn change_database(directory: &Path, script: &'static str) {
        let meta = SqliteMeta::open(directory).await.unwrap();
        sqlx::raw_sql(script).execute(meta.writer()).await.unwrap();
        meta.close().await;
    }

    #[tokio::test]
    async fn a_directory_belongs_to_one_process_and_opens_again() {
        let directory = tempfile::tempdir().unwrap();
        let first = Store::open(directory.path()).await.unwrap();
        assert!(matches!(Store::open(directory.path()).await, Err(StoreError::InUse)));
        first.check().await.unwrap();
        first.close().await;
        drop(first);
        Store::open(directory.path()).await.unwrap().check().await.unwrap();
    }

    #[tokio::test]
    async fn a_later_format_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        change_database(directory.path(), "PRAGMA user_version = 99").await;
        assert!(matches!(Store::open(directory.path()).await, Err(StoreError::Newer { found: 99, .. })));
    }

    /// A store whose tables are of an unreleased version, another program's database, and no database.
    #[tokio::test]
    async fn what_is_no_database_of_this_version_is_refused_and_can_be_erased() {
        let other_columns = "ALTER TABLE jobs RENAME COLUMN state TO status";
        let other_program = "PRAGMA user_version = 0";
        for change in [Some(other_columns), Some(other_program), None] {
            let directory = tempfile::tempdir().unwrap();
            match change {
                Some(change) => change_database(directory.path(), change).await,
                None => std::fs::write(directory.path().join(DATABASE), [b'x'; 5000]).unwrap(),
            }
            let refused = Store::open(directory.path()).await;
            assert!(matches!(refused, Err(StoreError::Foreign)), "{change:?}: {refused:?}");
            std::fs::write(directory.path().join("notes.txt"), "mine").unwrap();
            Store::erase(directory.path()).unwrap();
            let store = Store::open(directory.path()).await.unwrap();
            assert!(matches!(Store::erase(directory.path()), Err(StoreError::InUse)));
            store.close().await;
            assert_eq!(std::fs::read_to_string(directory.path().join("notes.txt")).unwrap(), "mine");
        }
    }
}
