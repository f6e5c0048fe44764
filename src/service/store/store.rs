mod jobs;
mod open;

use std::collections::BTreeMap;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use object_store::ObjectStore;

use super::directory::Watched;
use super::look::{Look, Seen, milliseconds};
use super::meta::Over;
use super::records::now_rfc3339;
use super::room::{FreeRoom, Room};
use super::{
    AnswerRecord, Blobs, Changes, MetaStore, OsteotomyId, OsteotomyRecord, Owner, PartKind, PartRecord, PlanId,
    PlanRecord, SessionContents, SessionId, SessionRecord, StoreError, StoredAnswer, TenantId,
};

/// Longest wait of [`Store::check`] for the bucket's answer.
///
/// A bucket that does not answer by then passes the check.
const BUCKET_ANSWERS: Duration = Duration::from_secs(2);
/// Files younger than this may belong to an unfinished request, so a sweep keeps them.
const UNDER_WAY: Duration = Duration::from_secs(2 * 3600);
/// A time after all others, RFC 3339.
const ALWAYS: &str = "9999-12-31T23:59:59.999Z";

type Result<T> = std::result::Result<T, StoreError>;

/// Rows and blobs of one store.
///
/// A row names a blob only after the blob is complete and synced, and a blob that no row names any more is removed. Clones
/// share the store.
#[derive(Debug, Clone)]
pub struct Store {
    meta: Arc<dyn MetaStore>,
    blobs: Blobs,
    quota: u64,
    shared: bool,
    /// Name of this process's audit log, under which the rows keep its anchor.
    log: Arc<str>,
    /// The lock of the data directory, and the database if it is there.
    watched: Arc<[Watched]>,
    room: Arc<Room>,
    /// Clock and running time at the last look.
    seen: Arc<Mutex<Seen>>,
}

impl Store {
    /// The same rows with blobs in `objects`, for example in an S3-compatible store.
    #[must_use]
    pub fn with_objects(self, objects: Arc<dyn ObjectStore>) -> Self {
        Self { blobs: Blobs::over(objects), ..self }
    }

    /// The same store with a quota of `bytes` for each session.
    #[must_use]
    pub fn with_quota(self, bytes: u64) -> Self {
        Self { quota: bytes, ..self }
    }

    /// Keeps `least` bytes of the local disks free from now on; nothing is kept free before.
    pub fn keep_free(&self, least: u64) {
        self.room.least.store(least, Ordering::Relaxed);
    }

    /// Room on the fullest local disk; `None` when all rows and blobs are elsewhere.
    ///
    /// # Errors
    /// The disk's.
    pub fn free_room(&self) -> Result<Option<FreeRoom>> {
        Ok(self.room.free()?)
    }

    /// Checks that there is room for more than deletions.
    ///
    /// # Errors
    /// [`StoreError::NoRoom`], else the disk's.
    pub fn check_room(&self) -> Result<()> {
        self.room.check()
    }

    /// The blobs: large immutable values.
    #[must_use]
    pub fn blobs(&self) -> &Blobs {
        &self.blobs
    }

    pub(super) fn meta(&self) -> &dyn MetaStore {
        self.meta.as_ref()
    }

    /// Whether other processes may use the same rows: true for Postgres.
    #[must_use]
    pub fn is_shared(&self) -> bool {
        self.shared
    }

    /// Quota of a session, bytes.
    #[must_use]
    pub fn quota(&self) -> u64 {
        self.quota
    }

    /// Bytes left of a session's quota.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn room(&self, session: SessionId) -> Result<u64> {
        Ok(self.quota.saturating_sub(self.meta.session_bytes(session).await?))
    }

    /// Removes the blobs of a failed write, unless the write may have been committed.
    async fn remove_refused(&self, error: &StoreError, keys: Vec<String>) {
        if !error.may_be_written() {
            self.blobs.remove(keys).await;
        }
    }

    // ---- sessions ----

    /// Stores a new session and the answer to repeat when the request comes again.
    ///
    /// # Errors
    /// [`StoreError::KeyTaken`] when another request used the idempotency key meanwhile.
    pub async fn insert_session(&self, session: &SessionRecord, answer: Option<&AnswerRecord>) -> Result<()> {
        self.meta.insert_session(session, answer).await
    }

    /// The session `id`; `None` when there is none.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn session(&self, id: SessionId) -> Result<Option<SessionRecord>> {
        self.meta.session(id).await
    }

    /// Newest sessions of a tenant (of all tenants when `None`), at most `limit`.
    ///
    /// With `before`, only sessions created before that session.
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

    /// Deletes a session with everything in it, and the jobs of other sessions that read it.
    ///
    /// Returns false when the session does not exist.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn delete_session(&self, id: SessionId) -> Result<bool> {
        let Some(elsewhere) = self.meta.delete_session(id).await? else { return Ok(false) };
        self.blobs.delete_session(id).await;
        self.blobs.remove(elsewhere).await;
        Ok(true)
    }

    /// Hides a session with everything in it, and the jobs of other sessions that read it.
    ///
    /// Their ids count as deleted and lists omit them, but all of it stays stored. Returns false when the session does not exist
    /// or is hidden already.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn hide_session(&self, id: SessionId) -> Result<bool> {
        self.meta.hide_session(id, false).await
    }

    /// Same as [`Store::hide_session`] for a session whose retention has ended.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn expire_session(&self, id: SessionId) -> Result<bool> {
        self.meta.hide_session(id, true).await
    }

    /// Undoes [`Store::hide_session`]; the session counts as used now.
    ///
    /// Returns false when the session does not exist or is not hidden.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn restore_session(&self, id: SessionId) -> Result<bool> {
        self.meta.restore_session(id).await
    }

    /// Sessions that were hidden `age` ago or earlier, both by the clock and by the running time of the service.
    ///
    /// A time of deletion that is still to come, from a clock that was ahead, counts by the running time alone. A session whose
    /// retention ended is left out unless it is still unused for `retention` by the settled clock.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn hidden_sessions(
        &self,
        look: &Look,
        age: Duration,
        retention: Option<Duration>,
    ) -> Result<Vec<SessionRecord>> {
        let unused_since = retention.map_or_else(|| ALWAYS.to_owned(), |retention| look.before(retention));
        let over =
            Over { before: look.plainly_before(age), now: look.now(), ran_ms: look.ran_before(age), unused_since };
        self.meta.hidden_sessions(&over).await
    }

    /// Sessions that were hidden because their retention ended, although they are not unused for `retention` by the clock now.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn wrongly_expired(&self, look: &Look, retention: Duration) -> Result<Vec<SessionRecord>> {
        self.meta.wrongly_expired(&look.plainly_before(retention)).await
    }

    /// Number of hidden sessions.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn count_hidden(&self) -> Result<u64> {
        self.meta.count_hidden().await
    }

    /// Sessions without a change for `idle` and without a waiting or running job.
    ///
    /// From a day on, `idle` is reckoned from the settled clock ([`Look::settled_ms`]).
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn idle_sessions(&self, look: &Look, idle: Duration) -> Result<Vec<SessionRecord>> {
        self.meta.idle_sessions(&look.before(idle)).await
    }

    /// Sessions without a change for `idle` by the clock as it is, and without a waiting or running job.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn seemingly_idle_sessions(&self, look: &Look, idle: Duration) -> Result<Vec<SessionRecord>> {
        self.meta.idle_sessions(&look.plainly_before(idle)).await
    }

    /// Time of the last change in a session, RFC 3339; `None` when the session does not exist.
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

    /// Contents of sessions, with at most `jobs` jobs each; sessions that do not exist are omitted.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn contents(&self, sessions: &[SessionId], jobs: u32) -> Result<BTreeMap<SessionId, SessionContents>> {
        self.meta.contents(sessions, jobs).await
    }

    /// The secret that signs links to single results, shared by all processes; set to `fresh` when there is none.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn link_key(&self, fresh: &str) -> Result<String> {
        self.meta.link_key(fresh).await
    }

    /// Owner of a session or job, also of a deleted one.
    ///
    /// `None` when the id was never used or its tombstone has expired.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn owner(&self, id: &str) -> Result<Option<Owner>> {
        self.meta.owner(id).await
    }

    /// Whether the id belongs to something that was deleted or hidden.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn is_deleted(&self, id: &str) -> Result<bool> {
        self.meta.is_deleted(id).await
    }

    // ---- answers ----

    /// The stored answer to a tenant's idempotency key, if any.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn remembered(&self, tenant: &TenantId, key: &str, request_sha256: &str) -> Result<StoredAnswer> {
        self.meta.remembered(tenant, key, request_sha256).await
    }

    /// Deletes answers older than `age`, and tombstones older than ten times `age` whose rows are gone.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn delete_old_answers(&self, look: &Look, age: Duration) -> Result<()> {
        self.meta.forget(&look.before(age), &look.before(age.saturating_mul(10))).await
    }

    // ---- parts ----

    /// Stores parts in one transaction, each in place of the earlier part of its kind.
    ///
    /// Removes the blobs that the parts replace; on failure removes the blobs that the parts name.
    ///
    /// # Errors
    /// [`StoreError::SessionGone`] when the session does not exist, [`StoreError::QuotaFull`].
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

    /// Removes a part of a session; false when there is none of this kind.
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

    /// One part of a session; `None` when there is none of this kind.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn part(&self, session: SessionId, kind: PartKind) -> Result<Option<PartRecord>> {
        Ok(self.parts(session).await?.into_iter().find(|p| p.kind == kind))
    }

    // ---- osteotomies and plans ----

    /// Stores an osteotomy; on failure removes the blobs that it names.
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

    /// One osteotomy of a session; `None` when there is none with this id.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn osteotomy(&self, session: SessionId, id: OsteotomyId) -> Result<Option<OsteotomyRecord>> {
        Ok(self.osteotomies(session).await?.into_iter().find(|o| o.id == id))
    }

    /// Deletes an osteotomy and its plans; false when it does not exist.
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
    /// [`StoreError::SessionGone`] when the session or the plan's osteotomy does not exist, [`StoreError::KeyTaken`].
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

    /// One plan of a session; `None` when there is none with this id.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn plan(&self, session: SessionId, id: PlanId) -> Result<Option<PlanRecord>> {
        Ok(self.plans(session).await?.into_iter().find(|p| p.id == id))
    }

    /// Replaces the document of a plan; nothing happens when the plan does not exist.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn set_plan(&self, session: SessionId, id: PlanId, document: &str) -> Result<()> {
        self.meta.set_plan(session, id, document).await
    }

    /// Deletes a plan; false when it does not exist.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn delete_plan(&self, session: SessionId, id: PlanId) -> Result<bool> {
        self.meta.delete_plan(session, id).await
    }

    // ---- jobs ----

    /// Removes blobs and unfinished uploads that no row names and that are older than two hours.
    ///
    /// Returns their number.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn sweep_old(&self) -> Result<usize> {
        self.sweep(UNDER_WAY).await
    }

    pub(super) async fn sweep(&self, older_than: Duration) -> Result<usize> {
        // Listed before the rows are read: a blob that is stored and named in between is not in the list.
        let found = self.blobs.older_than(older_than).await?;
        if found.is_empty() {
            return Ok(0);
        }
        let named = self.meta.named_blobs().await?;
        let unnamed: Vec<String> = found.into_iter().filter(|key| !named.contains(key)).collect();
        self.blobs.remove_files(&unnamed).await
    }

    /// Whether this process runs the maintenance round now.
    ///
    /// Of the processes that share the rows, one gets true in each interval `every`. A store that is not shared always gets true.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn claims_maintenance(&self, every: Duration) -> Result<bool> {
        Ok(!self.shared || self.meta.claim_maintenance(every).await?)
    }

    /// Looks at the clock for a maintenance round and counts the time that the service has run since the last look.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn look(&self) -> Result<Look> {
        let now = Seen::now();
        let before = std::mem::replace(&mut *self.seen.lock().unwrap_or_else(PoisonError::into_inner), now);
        let (elapsed, jumped_ms) = before.until(now);
        Ok(Look { jumped_ms, ..self.look_at(now.now_ms, elapsed).await? })
    }

    /// Same as [`Store::look`] at another time: at `now_ms` (since 1970), `elapsed` of running time after the look before.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn look_at(&self, now_ms: i64, elapsed: Duration) -> Result<Look> {
        let (clocks, now_ms) = self.meta.look(now_ms, milliseconds(elapsed), self.shared).await?;
        let begins_day = clocks.noted.is_some_and(|(_, ran_ms)| ran_ms == clocks.ran_ms);
        Ok(Look { now_ms, settled_ms: clocks.settled_at, ran_ms: clocks.ran_ms, jumped_ms: 0, begins_day })
    }

    /// Stores the end of the audit log (its anchor), so that a verification finds a removed tail.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn set_audit_anchor(&self, chain: &str) -> Result<()> {
        self.meta.set_audit_anchor(&self.log, chain, &now_rfc3339()).await
    }

    /// The stored end of the audit log (the chain's hash), and when it was stored (RFC 3339).
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn audit_anchor(&self) -> Result<Option<(String, String)>> {
        self.meta.audit_anchor(&self.log).await
    }

    /// Notifications of changes by other processes; `None` when the rows are not shared.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn changes(&self) -> Result<Option<Changes>> {
        self.meta.changes().await
    }

    /// Checks that the data directory and what is in it are still those that were opened: what is written otherwise is lost.
    ///
    /// # Errors
    /// [`StoreError::DirectoryGone`].
    pub fn check_directory(&self) -> Result<()> {
        self.watched.iter().try_for_each(Watched::check)?;
        self.blobs.check_directory()
    }

    /// Checks that the database answers and takes writes, and that the bucket does not refuse this process.
    ///
    /// A bucket that cannot be reached passes: jobs wait for it.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn check(&self) -> Result<()> {
        self.check_directory()?;
        self.meta.check().await?;
        match tokio::time::timeout(BUCKET_ANSWERS, self.blobs.name()).await {
            Ok(Err(error)) if !error.is_unreachable() => Err(error),
            _ => Ok(()),
        }
    }

    /// Checks that blobs can be written and read, without a time limit of its own.
    ///
    /// # Errors
    /// [`StoreError::BucketUnreachable`], [`StoreError::BucketDenied`].
    pub async fn check_writing(&self) -> Result<()> {
        self.blobs.check_writing().await
    }

    /// Closes all connections once their current statements are done.
    pub async fn close(&self) {
        self.meta.close().await;
    }
}
