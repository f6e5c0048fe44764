use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Debug;
use std::time::Duration;

use async_trait::async_trait;

use super::{
    AnswerRecord, BlobInfo, Changes, Claim, EventRecord, Insertion, JobChange, JobFilter, JobId, JobRecord, JobState,
    Lane, NewJob, OsteotomyId, OsteotomyRecord, Owner, PartKind, PartRecord, PlanId, PlanRecord, Remembered,
    SessionContents, SessionId, SessionRecord, StepRecord, StepWritten, StoreError, TenantId,
};

type Result<T> = std::result::Result<T, StoreError>;

/// Rows: sessions and what they hold, the queue, events. Every call is one transaction: it happens whole or not at all, and what
/// it returns as done survives the process (of an engine that is durable).
///
/// Knows no files: where rows that named blobs go, the names are returned, and the caller removes the blobs.
///
/// What every engine must do alike is written down as tests in `conformance`.
#[async_trait]
pub trait MetaStore: Debug + Send + Sync {
    // ---- sessions ----

    /// Stores a new session together with the answer that a repeated request gets.
    async fn insert_session(&self, session: &SessionRecord, answer: Option<&AnswerRecord>) -> Result<()>;

    /// A session, if it is there.
    async fn session(&self, id: SessionId) -> Result<Option<SessionRecord>>;

    /// Sessions of a tenant (of all when `None`), newest first, from those made before `before` on.
    async fn sessions(
        &self,
        tenant: Option<&TenantId>,
        before: Option<SessionId>,
        limit: u32,
    ) -> Result<Vec<SessionRecord>>;

    /// Deletes a session with everything in it, and jobs of other sessions that read it; ids answer [`MetaStore::is_deleted`]
    /// from then on. Blobs of other sessions that are not named any more; `None` when the session was not there.
    async fn delete_session(&self, id: SessionId) -> Result<Option<Vec<String>>>;

    /// Hides a session with everything in it, and jobs of other sessions that read it: ids answer [`MetaStore::is_deleted`] from then on, lists lack them,
    /// and all stays stored. False when it was not there, or was hidden already.
    async fn hide_session(&self, id: SessionId) -> Result<bool>;

    /// Takes [`MetaStore::hide_session`] back. False when the session is not there or not hidden.
    async fn restore_session(&self, id: SessionId) -> Result<bool>;

    /// Sessions that were hidden before `before` (RFC 3339).
    async fn hidden_sessions(&self, before: &str) -> Result<Vec<SessionRecord>>;

    /// Sessions in which nothing was made or changed since `since` (RFC 3339) and no job waits or runs.
    async fn idle_sessions(&self, since: &str) -> Result<Vec<SessionRecord>>;

    /// When something was last made or changed in a session, RFC 3339.
    async fn last_used(&self, id: SessionId) -> Result<Option<String>>;

    /// Bytes stored for a session.
    async fn session_bytes(&self, id: SessionId) -> Result<u64>;

    /// What sessions hold, with at most `jobs` jobs each; nothing for those that are not there.
    async fn contents(&self, sessions: &[SessionId], jobs: u32) -> Result<BTreeMap<SessionId, SessionContents>>;

    /// Whose a session or job is, or was.
    async fn owner(&self, id: &str) -> Result<Option<Owner>>;

    /// Whether something with this id was there and was deleted.
    async fn is_deleted(&self, id: &str) -> Result<bool>;

    // ---- answers ----

    /// What is known of a tenant's idempotency key.
    async fn remembered(&self, tenant: &TenantId, key: &str, request_sha256: &str) -> Result<Remembered>;

    /// Forgets answers from before `answers` and tombstones from before `tombstones`, RFC 3339.
    async fn forget(&self, answers: &str, tombstones: &str) -> Result<()>;

    // ---- parts ----

    /// Stores parts, each in place of the one before: the blobs that they replace. [`StoreError::QuotaFull`] when the session
    /// would be above `quota` bytes.
    async fn put_parts(&self, session: SessionId, parts: &[PartRecord], quota: u64) -> Result<Vec<String>>;

    /// Removes a part: its blob, where it had one; `None` when it was not there.
    async fn delete_part(&self, session: SessionId, kind: PartKind) -> Result<Option<Option<String>>>;

    /// All parts of a session.
    async fn parts(&self, session: SessionId) -> Result<Vec<PartRecord>>;

    // ---- osteotomies and plans ----

    /// Stores an osteotomy; as [`MetaStore::put_parts`] with the quota.
    async fn insert_osteotomy(&self, record: &OsteotomyRecord, answer: Option<&AnswerRecord>, quota: u64)
    -> Result<()>;

    /// Osteotomies of a session, oldest first.
    async fn osteotomies(&self, session: SessionId) -> Result<Vec<OsteotomyRecord>>;

    /// Deletes an osteotomy and its plans: its blobs; `None` when it was not there.
    async fn delete_osteotomy(&self, session: SessionId, id: OsteotomyId) -> Result<Option<Vec<String>>>;

    /// Stores a plan.
    async fn insert_plan(&self, record: &PlanRecord, answer: Option<&AnswerRecord>) -> Result<()>;

    /// Plans of a session, oldest first.
    async fn plans(&self, session: SessionId) -> Result<Vec<PlanRecord>>;

    /// Deletes a plan. False when it was not there.
    async fn delete_plan(&self, session: SessionId, id: PlanId) -> Result<bool>;

    // ---- jobs ----

    /// Stores an accepted job with its first event, unless the session has its twin or the queue is full; waiting jobs that it
    /// supersedes end in the same transaction.
    async fn insert_job(&self, new: &NewJob<'_>) -> Result<Insertion>;

    /// A job, if it is there.
    async fn job(&self, id: JobId) -> Result<Option<JobRecord>>;

    /// Jobs, newest first.
    async fn jobs(&self, filter: &JobFilter) -> Result<Vec<JobRecord>>;

    /// Accepted jobs of a lane that were not asked to stop, in the order in which they will be claimed: tenants take turns, the one whose turn was longest
    /// ago first; within a tenant the oldest first.
    async fn queue(&self, lane: Lane) -> Result<Vec<JobId>>;

    /// Takes the first job of the queue that is not left to another worker (see [`Claim`]): it is in the claimed state from now on, under a
    /// new fence and for the time of the lease, and its tenant had its turn. `change` is made from the row as it was.
    async fn claim_job(
        &self,
        claim: &Claim,
        change: &(dyn for<'a> Fn(&'a JobRecord) -> JobChange + Send + Sync),
    ) -> Result<Option<JobRecord>>;

    /// Leases a running job anew: whether it was asked to stop. `None` when it is not running under `fence` any more.
    async fn renew(&self, id: JobId, fence: u64, lease: Duration) -> Result<Option<bool>>;

    /// Running jobs whose lease has passed, by the clock of the engine.
    async fn abandoned(&self) -> Result<Vec<JobRecord>>;

    /// Moves a job from one state to another, with its events, if it is in `from` under `fence`. False when it is not, and when
    /// a job that was asked to stop would succeed, fail or run again.
    /// [`StoreError::QuotaFull`] when the change's blob takes the session above `quota` bytes.
    async fn change_job(
        &self,
        id: JobId,
        fence: u64,
        from: JobState,
        to: JobState,
        change: &JobChange,
        quota: u64,
    ) -> Result<bool>;

    /// Records that a job was asked to stop, so that no end but a cancel is left to it. False when it is not there or has ended.
    async fn request_cancel(&self, id: JobId) -> Result<bool>;

    /// Records how far a running job is, with an event. False when it is not running under `fence` any more.
    async fn record_progress(&self, id: JobId, fence: u64, phase: &str, progress: f64, event: &str) -> Result<bool>;

    /// Names the first large result of a running job: the blob that it replaces. [`StoreError::SessionGone`] when it is not
    /// running under `fence` any more.
    async fn set_rest(&self, id: JobId, fence: u64, rest: &BlobInfo, quota: u64) -> Result<Option<String>>;

    /// Names the last milestone of a running job: the blob that it replaces. [`StoreError::SessionGone`] when it is not running under
    /// `fence` any more. The name goes when the job ends.
    async fn set_milestone(&self, id: JobId, fence: u64, blob: &str) -> Result<Option<String>>;

    /// Forgets the steps and the milestone of a running job: their blobs. [`StoreError::SessionGone`] when it is not running under `fence`
    /// any more.
    async fn begin_again(&self, id: JobId, fence: u64) -> Result<Vec<String>>;

    // ---- steps and events ----

    /// Makes a step of a running job visible, with its events. [`StoreError::SessionGone`] when the job is not there or not
    /// running under `fence` any more.
    async fn commit_step(
        &self,
        job: JobId,
        fence: u64,
        step: &StepRecord,
        events: &[(&'static str, String)],
        quota: u64,
    ) -> Result<StepWritten>;

    /// Finished steps of jobs, in order; nothing for those that have none.
    async fn steps(&self, jobs: &[JobId]) -> Result<BTreeMap<JobId, Vec<StepRecord>>>;

    /// Events of a job after number `after`, in order.
    async fn events(&self, job: JobId, after: u64) -> Result<Vec<EventRecord>>;

    /// Drops all but the last event of jobs that ended before `ended_before` (RFC 3339): the number dropped.
    async fn prune_events(&self, ended_before: &str) -> Result<u64>;

    /// Drops the large results of comparisons that ended before `ended_before` (RFC 3339): their blobs.
    async fn drop_comparisons(&self, ended_before: &str) -> Result<Vec<String>>;

    // ---- the audit log ----

    /// Notes the chain at the end of an audit log, and when that was (RFC 3339).
    async fn set_audit_anchor(&self, log: &str, chain: &str, at: &str) -> Result<()>;

    /// The chain that was noted last for a log, and when.
    async fn audit_anchor(&self, log: &str) -> Result<Option<(String, String)>>;

    // ---- the engine ----

    /// The name of these rows, which the place of their blobs bears too: `fresh` when they had none.
    async fn name(&self, fresh: &str) -> Result<String>;

    /// Whether nobody has kept house for the time `every`: then it is the caller's turn.
    async fn take_turn(&self, every: Duration) -> Result<bool>;

    /// Keys of all blobs that a row names.
    async fn named_blobs(&self) -> Result<BTreeSet<String>>;

    /// What tells of changes by other processes; `None` where there are no others.
    async fn changes(&self) -> Result<Option<Changes>>;

    /// Whether it answers and can be written.
    async fn check(&self) -> Result<()>;

    /// Closes all connections after what is under way.
    async fn close(&self);
}
