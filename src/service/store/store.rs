mod jobs;
mod open;

use std::collections::BTreeMap;
use std::fs::File;
use std::sync::Arc;
use std::time::Duration;

use object_store::ObjectStore;

use super::directory::LOCAL_LOG;
use super::memory::MemoryMeta;
use super::records::{now_rfc3339, rfc3339_before};
use super::{
    AnswerRecord, Blobs, Changes, MetaStore, OsteotomyId, OsteotomyRecord, Owner, PartKind, PartRecord, PlanId,
    PlanRecord, Remembered, SessionContents, SessionId, SessionRecord, StoreError, TenantId,
};

/// Longest wait for a bucket that is asked whether it refuses this process.
const BUCKET_ANSWERS: Duration = Duration::from_secs(2);
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
    shared: bool,
    /// Name of the audit log beside it.
    log: Arc<str>,
    /// Held open for its lock.
    _lock: Option<Arc<File>>,
}

impl Store {
    /// A store that ends with the process.
    #[must_use]
    pub fn in_memory() -> Self {
        let (meta, blobs) = (Arc::new(MemoryMeta::default()), Blobs::in_memory());
        Self { meta, blobs, quota: u64::MAX, shared: false, log: LOCAL_LOG.into(), _lock: None }
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

    /// Large immutable values.
    #[must_use]
    pub fn blobs(&self) -> &Blobs {
        &self.blobs
    }

    pub(super) fn meta(&self) -> &dyn MetaStore {
        self.meta.as_ref()
    }

    /// Whether other processes may use the rows at the same time.
    #[must_use]
    pub fn is_shared(&self) -> bool {
        self.shared
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

    /// Removes blobs that rows were to name and do not.
    async fn remove_refused(&self, error: &StoreError, keys: Vec<String>) {
        if !error.may_be_written() {
            self.blobs.remove(keys).await;
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
        self.blobs.delete_session(id).await;
        self.blobs.remove(elsewhere).await;
        Ok(true)
    }

    /// Hides a session with everything in it, and jobs of other sessions that read it: they answer as deleted, lists lack them, and all stays stored. False when
    /// it was not there, or was hidden already.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn hide_session(&self, id: SessionId) -> Result<bool> {
        self.meta.hide_session(id).await
    }

    /// Takes [`Store::hide_session`] back. False when the session is not there or not hidden.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn restore_session(&self, id: SessionId) -> Result<bool> {
        self.meta.restore_session(id).await
    }

    /// Sessions that have been hidden for `age`.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn hidden_sessions(&self, age: Duration) -> Result<Vec<SessionRecord>> {
        self.meta.hidden_sessions(&rfc3339_before(age)).await
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
                self.blobs.remove(replaced).await;
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
        self.blobs.remove(blob.into_iter().collect()).await;
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
        self.blobs.remove(blobs).await;
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

    pub(super) async fn sweep(&self, older_than: Duration) -> Result<usize> {
        // Listed before the rows are read: what is stored and named in between is not among the files.
        let found = self.blobs.older_than(older_than).await?;
        if found.is_empty() {
            return Ok(0);
        }
        let named = self.meta.named_blobs().await?;
        let unnamed: Vec<String> = found.into_iter().filter(|key| !named.contains(key)).collect();
        self.blobs.remove_files(&unnamed).await
    }

    /// Whether this process shall keep house now: of those that share the rows one does in the time `every`.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn takes_turn(&self, every: Duration) -> Result<bool> {
        Ok(!self.shared || self.meta.take_turn(every).await?)
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

    /// What tells of changes by other processes; `None` where there are no others.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn changes(&self) -> Result<Option<Changes>> {
        self.meta.changes().await
    }

    /// Whether the database answers and can be written, and the bucket does not refuse this process; one that is away is waited for.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn check(&self) -> Result<()> {
        self.meta.check().await?;
        match tokio::time::timeout(BUCKET_ANSWERS, self.blobs.name()).await {
            Ok(Err(error)) if !error.is_away() => Err(error),
            _ => Ok(()),
        }
    }

    /// Whether values can be written and read, however long that takes to find out.
    ///
    /// # Errors
    /// [`StoreError::BucketAway`], [`StoreError::BucketRefused`].
    pub async fn check_writing(&self) -> Result<()> {
        self.blobs.check_writing().await
    }

    /// Closes all connections after what is under way.
    pub async fn close(&self) {
        self.meta.close().await;
    }
}
