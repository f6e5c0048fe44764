use std::str::FromStr;
use std::time::Duration;

use super::{AnswerRecord, BlobInfo, JobId, JobState, SessionId, StoreError, TenantId, WorkerId, now_rfc3339};

/// Kind of a job, by its result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JobKind {
    /// Skin, skull, air and soft tissue from a CT.
    Import,
    /// Distance fields.
    Field,
    /// Tissue mesh.
    Mesh,
    /// Deformed skin along a plan.
    Solve,
    /// Signed error between two surfaces.
    Compare,
}

impl JobKind {
    /// Every kind.
    pub const ALL: [Self; 5] = [Self::Import, Self::Field, Self::Mesh, Self::Solve, Self::Compare];

    /// Name on the wire and in the database.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Import => "import",
            Self::Field => "field",
            Self::Mesh => "mesh",
            Self::Solve => "solve",
            Self::Compare => "compare",
        }
    }

    /// Lane in which jobs of this kind wait.
    #[must_use]
    pub fn lane(self) -> Lane {
        match self {
            Self::Import | Self::Field | Self::Mesh | Self::Solve => Lane::Heavy,
            Self::Compare => Lane::Quick,
        }
    }
}

impl FromStr for JobKind {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|k| k.as_str() == text).ok_or_else(|| format!("`{text}` is not a kind of job"))
    }
}

/// One of the job queues. Separate lanes keep jobs of seconds from waiting for jobs of minutes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Lane {
    /// Jobs of minutes, computed on the threads for jobs.
    Heavy,
    /// Jobs of seconds, computed on the threads for requests.
    Quick,
}

impl Lane {
    /// Every lane.
    pub const ALL: [Self; 2] = [Self::Heavy, Self::Quick];

    /// Name in the database and in metrics.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Heavy => "heavy",
            Self::Quick => "quick",
        }
    }
}

/// A job's row.
#[derive(Debug, Clone, PartialEq)]
pub struct JobRecord {
    /// Order in the queue of its tenant: jobs with lower numbers run first.
    pub number: u64,
    /// Its id.
    pub id: JobId,
    /// Its session.
    pub session: SessionId,
    /// Its tenant.
    pub tenant: TenantId,
    /// Its kind.
    pub kind: JobKind,
    /// Its state.
    pub state: JobState,
    /// Current stage, one word.
    pub phase: String,
    /// Progress, 0 to 1.
    pub progress: f64,
    /// Number of steps that a solve produces; 0 for other kinds.
    pub steps: u32,
    /// Number of attempts so far.
    pub attempt: u32,
    /// Number of claims; a write with an older number is refused.
    pub fence: u64,
    /// End of the lease, ms since 1970 by the store's clock; `None` before the first claim.
    pub lease_until: Option<i64>,
    /// The request, JSON.
    pub request: String,
    /// Subject, for example the id of a plan: a newer job with the same subject may supersede this one.
    pub subject: Option<String>,
    /// Another session that the job reads; when either session is deleted, the job is deleted too.
    pub other_session: Option<SessionId>,
    /// Longest computing time of one attempt, s.
    pub max_wall_s: Option<f64>,
    /// W3C `traceparent` of the request that created the job; `None` when no traces are sent.
    pub traceparent: Option<String>,
    /// When cancellation was requested, RFC 3339: from then on the job can only end as cancelled.
    pub cancel_requested_at: Option<String>,
    /// The newer job that superseded this one.
    pub superseded_by: Option<JobId>,
    /// The job that missed its budget and that this one continues.
    pub continues: Option<JobId>,
    /// The job that continues this one.
    pub continued_by: Option<JobId>,
    /// Number of the first event that is still stored.
    pub events_from: u64,
    /// Its report, JSON, once it has succeeded.
    pub report: Option<String>,
    /// Why it failed, JSON.
    pub fault: Option<String>,
    /// Warnings.
    pub warnings: Vec<String>,
    /// Blob of the skin at rest; of a comparison, blob of the surface that its values belong to.
    pub rest_blob: Option<String>,
    /// Blob of the deformed volume (VTU); of a comparison, blob of the values.
    pub tissue_blob: Option<String>,
    /// Blob of the last checkpoint of an unfinished job, from which another worker can continue.
    pub checkpoint_blob: Option<String>,
    /// When it was accepted, RFC 3339.
    pub created_at: String,
    /// Start of the last attempt, RFC 3339.
    pub started_at: Option<String>,
    /// When it ended, RFC 3339.
    pub finished_at: Option<String>,
}

impl JobRecord {
    /// A new accepted job with default values.
    ///
    /// The store sets its number and its tenant (that of the session).
    #[must_use]
    pub fn accepted(kind: JobKind, session: SessionId, request: String) -> Self {
        Self {
            number: 0,
            id: JobId::new(),
            session,
            tenant: TenantId::local(),
            kind,
            state: JobState::Accepted,
            phase: "waiting".to_owned(),
            progress: 0.0,
            steps: 0,
            attempt: 0,
            fence: 0,
            lease_until: None,
            request,
            subject: None,
            other_session: None,
            max_wall_s: None,
            traceparent: None,
            cancel_requested_at: None,
            superseded_by: None,
            continues: None,
            continued_by: None,
            events_from: 1,
            report: None,
            fault: None,
            warnings: Vec::new(),
            rest_blob: None,
            tissue_blob: None,
            checkpoint_blob: None,
            created_at: now_rfc3339(),
            started_at: None,
            finished_at: None,
        }
    }

    /// Whether the row allows a change from the state `from` to `to` under `fence`.
    pub(super) fn may_change(&self, from: JobState, fence: u64, to: JobState) -> bool {
        let stops = matches!(to, JobState::Cancelled | JobState::Interrupted);
        self.state == from && self.fence == fence && (stops || self.cancel_requested_at.is_none())
    }
}

/// Which jobs to list.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct JobFilter {
    /// Only of this tenant.
    pub tenant: Option<TenantId>,
    /// Only of this session.
    pub session: Option<SessionId>,
    /// Only of this kind.
    pub kind: Option<JobKind>,
    /// Only in this state.
    pub state: Option<JobState>,
    /// Only created before this job.
    pub before: Option<JobId>,
    /// Largest number of jobs to return.
    pub limit: u32,
}

/// A change of a job's state, with the values that are written in the same transaction.
#[derive(Debug, Clone, Default)]
pub struct JobChange {
    /// New stage; unchanged when `None`.
    pub phase: Option<&'static str>,
    /// New progress, 0 to 1; unchanged when `None`.
    pub progress: Option<f64>,
    /// Change of the number of attempts; -1 takes an attempt back.
    pub attempt_change: i64,
    /// The report, JSON; unchanged when `None`.
    pub report: Option<String>,
    /// Why it failed, JSON.
    pub fault: Option<String>,
    /// Warnings to add; each is stored once.
    pub warnings: Vec<String>,
    /// The second large result: the deformed volume, or the values of a comparison.
    pub tissue: Option<BlobInfo>,
    /// Kind and JSON of the events to append.
    pub events: Vec<(&'static str, String)>,
    /// An accepted job of the same session that continues this one, and the JSON of its first event, of kind `status`.
    ///
    /// It is stored whatever the limits of the queue: the client's request was accepted within them.
    pub continuation: Option<Box<(JobRecord, String)>>,
}

/// Limits on the number of waiting jobs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QueueLimits {
    /// Of all tenants together.
    pub all: u32,
    /// Of one tenant.
    pub tenant: u32,
}

/// Which waiting jobs of its session and kind a new job supersedes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SupersedeScope {
    /// Those with the same subject.
    Subject,
    /// All.
    Session,
}

/// How a new job supersedes waiting jobs of the same session and kind.
#[derive(Debug, Clone)]
pub struct Supersede {
    /// Which jobs are superseded.
    pub scope: SupersedeScope,
    /// State in which a job may be superseded.
    pub from: JobState,
    /// State of a superseded job.
    pub to: JobState,
    /// Kind and JSON of the event to append to a superseded job.
    pub event: (&'static str, String),
}

/// A job to store, with the rules for storing it.
pub struct NewJob<'a> {
    /// Its row; the store sets the tenant and the number.
    pub job: &'a JobRecord,
    /// Limits of the queue.
    pub limits: QueueLimits,
    /// JSON of its first event, of kind `status`.
    pub event: &'a str,
    /// How older waiting jobs are superseded; `None` when they are kept.
    pub supersede: Option<Supersede>,
    /// Makes the answer to repeat, from the stored job or its twin and its position in the queue.
    pub answer: &'a AnswerOf<'a>,
}

/// Makes an answer from a job and the number of jobs before it in its lane (`None` unless it waits).
pub type AnswerOf<'a> = dyn Fn(&JobRecord, Option<u32>) -> Option<AnswerRecord> + Send + Sync + 'a;

impl std::fmt::Debug for NewJob<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("NewJob").field("job", &self.job.id).field("limits", &self.limits).finish_non_exhaustive()
    }
}

/// A worker's request for the next job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Claim {
    /// Lane to take the job from.
    pub lane: Lane,
    /// The worker that claims; `None` takes every job in order.
    ///
    /// The worker that began the last job of a session knows the session: it still has its fields and meshes in memory. Of each
    /// tenant's jobs, a worker first takes those of sessions that it knows or no worker knows. A job of a session that another
    /// worker knows waits [`Claim::HEAD_START`] for that worker.
    pub worker: Option<WorkerId>,
    /// How long jobs of sessions that the worker knows may go before an older job.
    pub patience: Duration,
    /// State of the claimed job.
    pub to: JobState,
    /// Length of the lease, until it is renewed.
    pub lease: Duration,
}

impl Claim {
    /// How long a job is left to the worker that knows its session.
    ///
    /// One second is short for the client and long enough for a free worker to claim the job.
    pub const HEAD_START: Duration = Duration::from_secs(1);
    /// Default of [`Claim::patience`].
    ///
    /// When all workers are busy, every job waits for longer than the head start. If workers then took jobs in the order of their
    /// numbers, each worker would rebuild the fields and meshes of all sessions while the load is highest.
    pub const PATIENCE: Duration = Duration::from_secs(60);
}

/// Result of storing a job.
#[derive(Debug, Clone, PartialEq)]
pub enum Insertion {
    /// The job is stored.
    Stored {
        /// Superseded jobs with the blobs of their checkpoints, which no row names any more.
        superseded: Vec<(JobId, Option<String>)>,
        /// Number of jobs before it in its lane.
        before: u32,
    },
    /// The session has an unfinished job with the same request (its twin) and no cancellation request.
    ///
    /// With the number of jobs before the twin when it waits.
    Twin(Box<JobRecord>, Option<u32>),
    /// Too many jobs of all tenants wait.
    Full,
    /// Too many jobs of the tenant wait.
    TenantFull,
}

/// The warnings of a row and `new` ones, without duplicates.
pub(super) fn joined_warnings(mut warnings: Vec<String>, new: &[String]) -> Vec<String> {
    for warning in new {
        if !warnings.contains(warning) {
            warnings.push(warning.clone());
        }
    }
    warnings
}

/// Progress after a change to the state `to`.
pub(super) fn progress_after(to: JobState, change: Option<f64>, before: f64) -> f64 {
    match to {
        JobState::Succeeded => 1.0,
        JobState::Accepted => 0.0,
        JobState::Running | JobState::Failed | JobState::Cancelled | JobState::Interrupted => change.unwrap_or(before),
    }
}

/// Refuses a write that takes a session above its quota, both in bytes.
pub(super) fn check_quota(bytes: u64, quota: u64) -> Result<(), StoreError> {
    if bytes > quota { Err(StoreError::QuotaFull { allowed: quota }) } else { Ok(()) }
}
