use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Debug;
use std::time::Duration;

use async_trait::async_trait;

use super::{
    AnswerRecord, BlobInfo, Changes, Claim, Clocks, EventRecord, Insertion, JobChange, JobFilter, JobId, JobRecord,
    JobState, Lane, NewJob, OsteotomyId, OsteotomyRecord, Owner, PartKind, PartRecord, PlanId, PlanRecord,
    SessionContents, SessionId, SessionRecord, StepRecord, StepWritten, StoreError, StoredAnswer, TenantId,
};

type Result<T> = std::result::Result<T, StoreError>;

/// What holds of a hidden session that may be deleted for good.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Over {
    /// It was hidden before this time (RFC 3339), …
    pub before: String,
    /// … or after this one: by a clock that was ahead.
    pub now: String,
    /// It was hidden at this running time or before, ms.
    pub ran_ms: i64,
    /// If its retention ended, it was not changed since then (RFC 3339).
    pub unused_since: String,
}

/// The rows of a store: sessions and their contents, the job queue, and events.
///
/// Every call is one transaction: it takes effect completely or not at all. On a durable engine a completed call survives the
/// end of the process.
///
/// An engine knows no blobs. Calls that remove rows return the keys of their blobs, and the caller removes these.
///
/// The tests in `conformance` define the behaviour that all engines share.
#[async_trait]
pub trait MetaStore: Debug + Send + Sync {
    // ---- sessions ----

    /// Stores a new session and the answer to repeat when the request comes again.
    async fn insert_session(&self, session: &SessionRecord, answer: Option<&AnswerRecord>) -> Result<()>;

    /// The session `id`; `None` when there is none.
    async fn session(&self, id: SessionId) -> Result<Option<SessionRecord>>;

    /// Newest sessions of a tenant (of all tenants when `None`), at most `limit`.
    ///
    /// With `before`, only sessions created before that session.
    async fn sessions(
        &self,
        tenant: Option<&TenantId>,
        before: Option<SessionId>,
        limit: u32,
    ) -> Result<Vec<SessionRecord>>;

    /// Deletes a session with everything in it, and the jobs of other sessions that read it.
    ///
    /// Leaves tombstones of their ids.
    ///
    /// Returns the blobs of other sessions that no row names any more; `None` when the session does not exist.
    async fn delete_session(&self, id: SessionId) -> Result<Option<Vec<String>>>;

    /// Hides a session with everything in it, and the jobs of other sessions that read it.
    ///
    /// Their ids count as deleted ([`MetaStore::is_deleted`]) and lists omit them, but all of it stays stored. Returns false when
    /// the session does not exist or is hidden already.
    ///
    /// `expired` says that its retention ended, not that a user deleted it.
    async fn hide_session(&self, id: SessionId, expired: bool) -> Result<bool>;

    /// Undoes [`MetaStore::hide_session`]; false when the session does not exist or is not hidden.
    ///
    /// The session counts as used now, so that its retention begins anew.
    async fn restore_session(&self, id: SessionId) -> Result<bool>;

    /// Hidden sessions that may be deleted for good.
    async fn hidden_sessions(&self, over: &Over) -> Result<Vec<SessionRecord>>;

    /// Sessions that were hidden because their retention ended, and that were changed since `since` (RFC 3339).
    async fn wrongly_expired(&self, since: &str) -> Result<Vec<SessionRecord>>;

    /// Number of hidden sessions.
    async fn count_hidden(&self) -> Result<u64>;

    /// Sessions without a change since `since` (RFC 3339) and without a waiting or running job.
    async fn idle_sessions(&self, since: &str) -> Result<Vec<SessionRecord>>;

    /// Time of the last change in a session, RFC 3339; `None` when the session does not exist.
    async fn last_used(&self, id: SessionId) -> Result<Option<String>>;

    /// Bytes stored for a session.
    async fn session_bytes(&self, id: SessionId) -> Result<u64>;

    /// Contents of sessions, with at most `jobs` jobs each; sessions that do not exist are omitted.
    async fn contents(&self, sessions: &[SessionId], jobs: u32) -> Result<BTreeMap<SessionId, SessionContents>>;

    /// Owner of a session or job, also of a deleted one.
    ///
    /// `None` when the id was never used or its tombstone has expired.
    async fn owner(&self, id: &str) -> Result<Option<Owner>>;

    /// Whether the id has a tombstone: it belongs to something that was deleted or hidden.
    async fn is_deleted(&self, id: &str) -> Result<bool>;

    // ---- answers ----

    /// The stored answer to a tenant's idempotency key, if any.
    async fn remembered(&self, tenant: &TenantId, key: &str, request_sha256: &str) -> Result<StoredAnswer>;

    /// Deletes answers older than `answers`, and tombstones older than `tombstones` whose rows are gone (times, RFC 3339).
    async fn forget(&self, answers: &str, tombstones: &str) -> Result<()>;

    // ---- parts ----

    /// Stores parts, each in place of the earlier part of its kind; returns the blobs that they replace.
    ///
    /// [`StoreError::QuotaFull`] when the session would exceed `quota` bytes.
    async fn put_parts(&self, session: SessionId, parts: &[PartRecord], quota: u64) -> Result<Vec<String>>;

    /// Removes a part; returns its blob if it has one, `None` when the part does not exist.
    async fn delete_part(&self, session: SessionId, kind: PartKind) -> Result<Option<Option<String>>>;

    /// All parts of a session.
    async fn parts(&self, session: SessionId) -> Result<Vec<PartRecord>>;

    // ---- osteotomies and plans ----

    /// Stores an osteotomy; `quota` as in [`MetaStore::put_parts`].
    async fn insert_osteotomy(&self, record: &OsteotomyRecord, answer: Option<&AnswerRecord>, quota: u64)
    -> Result<()>;

    /// Osteotomies of a session, oldest first.
    async fn osteotomies(&self, session: SessionId) -> Result<Vec<OsteotomyRecord>>;

    /// Deletes an osteotomy and its plans; returns its blobs, `None` when it does not exist.
    async fn delete_osteotomy(&self, session: SessionId, id: OsteotomyId) -> Result<Option<Vec<String>>>;

    /// Stores a plan.
    async fn insert_plan(&self, record: &PlanRecord, answer: Option<&AnswerRecord>) -> Result<()>;

    /// Plans of a session, oldest first.
    async fn plans(&self, session: SessionId) -> Result<Vec<PlanRecord>>;

    /// Replaces the document of a plan, if it exists.
    async fn set_plan(&self, session: SessionId, id: PlanId, document: &str) -> Result<()>;

    /// Deletes a plan; false when it does not exist.
    async fn delete_plan(&self, session: SessionId, id: PlanId) -> Result<bool>;

    // ---- jobs ----

    /// Stores an accepted job with its first event, unless the session has its twin or the queue is full.
    ///
    /// Waiting jobs that it supersedes end in the same transaction.
    async fn insert_job(&self, new: &NewJob<'_>) -> Result<Insertion>;

    /// The job `id`; `None` when there is none.
    async fn job(&self, id: JobId) -> Result<Option<JobRecord>>;

    /// Jobs, newest first.
    async fn jobs(&self, filter: &JobFilter) -> Result<Vec<JobRecord>>;

    /// Accepted jobs of a lane in the order in which workers claim them.
    ///
    /// Jobs with a cancellation request are omitted.
    ///
    /// Tenants take turns: the tenant whose last turn is longest ago comes first. Within a tenant the oldest job comes first.
    async fn queue(&self, lane: Lane) -> Result<Vec<JobId>>;

    /// Claims the first job of the queue that is not left to another worker (see [`Claim`]).
    ///
    /// The job gets the claimed state, a new fence and a lease, and its tenant's turn is recorded. `change` makes the change from
    /// the row before the claim.
    async fn claim_job(
        &self,
        claim: &Claim,
        change: &(dyn for<'a> Fn(&'a JobRecord) -> JobChange + Send + Sync),
    ) -> Result<Option<JobRecord>>;

    /// Renews the lease of a running job; returns whether its cancellation was requested.
    ///
    /// `None` when the job does not run under `fence` any more.
    async fn renew(&self, id: JobId, fence: u64, lease: Duration) -> Result<Option<bool>>;

    /// Running jobs whose lease has expired by the engine's clock.
    async fn abandoned(&self) -> Result<Vec<JobRecord>>;

    /// Changes the state of a job and appends events, if the job is in the state `from` under `fence`.
    ///
    /// Returns false when it is not, or when its cancellation was requested and `to` is neither cancelled nor interrupted.
    /// [`StoreError::QuotaFull`] when the blob of the change takes the session above `quota` bytes.
    async fn change_job(
        &self,
        id: JobId,
        fence: u64,
        from: JobState,
        to: JobState,
        change: &JobChange,
        quota: u64,
    ) -> Result<bool>;

    /// Records a cancellation request: from then on the job can only end as cancelled.
    ///
    /// Returns false when the job does not exist or has ended.
    async fn request_cancel(&self, id: JobId) -> Result<bool>;

    /// Stores the progress of a running job with an event.
    ///
    /// False when it does not run under `fence` any more.
    async fn record_progress(&self, id: JobId, fence: u64, phase: &str, progress: f64, event: &str) -> Result<bool>;

    /// Stores the key of a running job's first large result; returns the blob that it replaces.
    ///
    /// [`StoreError::SessionGone`] when the job does not run under `fence` any more.
    async fn set_rest(&self, id: JobId, fence: u64, rest: &BlobInfo, quota: u64) -> Result<Option<String>>;

    /// Stores the key of a running job's last checkpoint; returns the blob that it replaces.
    ///
    /// The key is cleared when the job ends. [`StoreError::SessionGone`] when the job does not run under `fence` any more.
    async fn set_checkpoint(&self, id: JobId, fence: u64, blob: &str) -> Result<Option<String>>;

    /// Deletes the steps and the checkpoint of a running job; returns their blobs.
    ///
    /// [`StoreError::SessionGone`] when the job does not run under `fence` any more.
    async fn begin_again(&self, id: JobId, fence: u64) -> Result<Vec<String>>;

    // ---- steps and events ----

    /// Stores a step of a running job with its events.
    ///
    /// [`StoreError::SessionGone`] when the job does not run under `fence` any more.
    async fn commit_step(
        &self,
        job: JobId,
        fence: u64,
        step: &StepRecord,
        events: &[(&'static str, String)],
        quota: u64,
    ) -> Result<StepWritten>;

    /// Finished steps of jobs, in order; jobs without steps are omitted.
    async fn steps(&self, jobs: &[JobId]) -> Result<BTreeMap<JobId, Vec<StepRecord>>>;

    /// Events of a job after number `after`, in order.
    async fn events(&self, job: JobId, after: u64) -> Result<Vec<EventRecord>>;

    /// Deletes all but the last event of jobs that ended before `ended_before` (RFC 3339).
    ///
    /// Returns the number deleted.
    async fn prune_events(&self, ended_before: &str) -> Result<u64>;

    /// Clears the large results of comparisons that ended before `ended_before` (RFC 3339).
    ///
    /// Returns their blobs.
    async fn drop_comparisons(&self, ended_before: &str) -> Result<Vec<String>>;

    // ---- the audit log ----

    /// Stores the chain at the end of an audit log (its anchor), and the time `at` (RFC 3339).
    async fn set_audit_anchor(&self, log: &str, chain: &str, at: &str) -> Result<()>;

    /// The stored chain of an audit log, and when it was stored.
    async fn audit_anchor(&self, log: &str) -> Result<Option<(String, String)>>;

    // ---- the engine ----

    /// The name of this database, which its bucket also stores; set to `fresh` when there is none.
    async fn name(&self, fresh: &str) -> Result<String>;

    /// The secret that signs links to single results; set to `fresh` when there is none.
    async fn link_key(&self, fresh: &str) -> Result<String>;

    /// Whether no process has begun a maintenance round for the time `every`, or one has at a time that is still to come.
    ///
    /// If so, records that the caller begins one.
    async fn claim_maintenance(&self, every: Duration) -> Result<bool>;

    /// Moves the stored clocks on to a look at `now_ms`, `elapsed_ms` of running time after the one before.
    ///
    /// Returns them and the time of the look, ms since 1970. With `shared`, no more counts than the engine's own clock shows: the
    /// earlier of both times, the shorter of both intervals.
    async fn look(&self, now_ms: i64, elapsed_ms: i64, shared: bool) -> Result<(Clocks, i64)>;

    /// Keys of all blobs that a row names.
    async fn named_blobs(&self) -> Result<BTreeSet<String>>;

    /// Notifications of changes by other processes; `None` when the rows are not shared.
    async fn changes(&self) -> Result<Option<Changes>>;

    /// Checks that the engine answers and takes writes.
    async fn check(&self) -> Result<()>;

    /// Closes all connections once their current statements are done.
    async fn close(&self);
}
