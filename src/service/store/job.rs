use std::str::FromStr;
use std::time::Duration;

use super::{AnswerRecord, BlobInfo, JobId, JobState, SessionId, StoreError, TenantId, WorkerId, now_rfc3339};

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
    /// Signed error between two surfaces.
    Compare,
}

impl JobKind {
    /// Every kind.
    pub const ALL: [Self; 5] = [Self::Import, Self::Field, Self::Mesh, Self::Solve, Self::Compare];

    /// Its name on the wire and in the database.
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

    /// Where it waits.
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

/// Queue of its own, so that work of seconds does not wait for work of minutes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Lane {
    /// Work of minutes, on the threads for jobs.
    Heavy,
    /// Work of seconds, on the threads for requests.
    Quick,
}

impl Lane {
    /// Every lane.
    pub const ALL: [Self; 2] = [Self::Heavy, Self::Quick];

    /// Its name in the database and in metrics.
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
    /// Its place in the queue of its tenant: lower ones run first.
    pub number: u64,
    /// Its id.
    pub id: JobId,
    /// Its session.
    pub session: SessionId,
    /// Whose it is.
    pub tenant: TenantId,
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
    /// Counts claims; what is written under an older one is refused.
    pub fence: u64,
    /// Until when it is its worker's, ms of the store's clock; none before it was first claimed.
    pub lease_until: Option<i64>,
    /// What was asked for, JSON.
    pub request: String,
    /// What it is about (a plan's id): a newer job about the same may take its place.
    pub subject: Option<String>,
    /// Another session that it reads; it does not outlive that one either.
    pub other_session: Option<SessionId>,
    /// Longest time that an attempt may compute, s.
    pub max_wall_s: Option<f64>,
    /// The trace that it goes on, W3C; none where no traces are sent.
    pub traceparent: Option<String>,
    /// When it was asked to stop, RFC 3339: from then on it can only end as cancelled.
    pub cancel_requested_at: Option<String>,
    /// The newer job that took its place.
    pub superseded_by: Option<JobId>,
    /// Events before this number are not kept any more.
    pub events_from: u64,
    /// Its report, JSON, once it has succeeded.
    pub report: Option<String>,
    /// Why it failed, JSON.
    pub fault: Option<String>,
    /// What a caller should know.
    pub warnings: Vec<String>,
    /// Blob of the skin at rest; of a comparison, of the surface that its values lie on.
    pub rest_blob: Option<String>,
    /// Blob of the deformed volume, VTU; of a comparison, of the values.
    pub tissue_blob: Option<String>,
    /// Blob of the last milestone of a job that has not ended: with it another worker goes on.
    pub milestone_blob: Option<String>,
    /// RFC 3339.
    pub created_at: String,
    /// Start of the last attempt, RFC 3339.
    pub started_at: Option<String>,
    /// RFC 3339.
    pub finished_at: Option<String>,
}

impl JobRecord {
    /// A new job that waits, with no more than it must have; the store numbers it and knows whose the session is.
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
            events_from: 1,
            report: None,
            fault: None,
            warnings: Vec::new(),
            rest_blob: None,
            tissue_blob: None,
            milestone_blob: None,
            created_at: now_rfc3339(),
            started_at: None,
            finished_at: None,
        }
    }

    /// Whether a change under `fence` from the state `from` to `to` is allowed as the row stands.
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
    /// Only made before this one.
    pub before: Option<JobId>,
    /// At most so many.
    pub limit: u32,
}

/// A change of state and what is written with it.
#[derive(Debug, Clone, Default)]
pub struct JobChange {
    /// Stage from now on; as before when absent.
    pub phase: Option<&'static str>,
    /// Done share from now on; as before when absent.
    pub progress: Option<f64>,
    /// Added to the attempts.
    pub attempt_change: i64,
    /// The report, JSON.
    pub report: Option<String>,
    /// Why it failed, JSON.
    pub fault: Option<String>,
    /// Added to what a caller should know.
    pub warnings: Vec<String>,
    /// The second large result.
    pub tissue: Option<BlobInfo>,
    /// Kind and JSON of the events that tell of it.
    pub events: Vec<(&'static str, String)>,
}

/// Jobs that may wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QueueLimits {
    /// In all.
    pub all: u32,
    /// Of one tenant.
    pub tenant: u32,
}

/// How a waiting job of the same session, kind and subject makes room for a newer one.
#[derive(Debug, Clone)]
pub struct Supersede {
    /// State in which a job may be replaced.
    pub from: JobState,
    /// State of a replaced job.
    pub to: JobState,
    /// Kind and JSON of the event that tells of it.
    pub event: (&'static str, String),
}

/// A job to be stored.
pub struct NewJob<'a> {
    /// Its row; the tenant is the session's, the number the store's.
    pub job: &'a JobRecord,
    /// Bounds of the queue.
    pub limits: QueueLimits,
    /// JSON of its first event, `status`.
    pub event: &'a str,
    /// Whether and how older ones make room.
    pub supersede: Option<Supersede>,
    /// What a repeated request gets, from the job as stored or its twin, and the jobs that wait before it in its lane.
    pub answer: &'a AnswerOf<'a>,
}

/// Makes an answer from a job and the number of jobs that wait before it; no number for a job that does not wait.
pub type AnswerOf<'a> = dyn Fn(&JobRecord, Option<u32>) -> Option<AnswerRecord> + Send + Sync + 'a;

impl std::fmt::Debug for NewJob<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("NewJob").field("job", &self.job.id).field("limits", &self.limits).finish_non_exhaustive()
    }
}

/// What a worker asks of the queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Claim {
    /// Where it looks.
    pub lane: Lane,
    /// Who asks. A worker knows the sessions whose last job it began: it has their fields and meshes at hand. Of a tenant's jobs it takes
    /// first those of sessions that it or nobody knows, and for [`Claim::HEAD_START`] it leaves others' to them. Without a name
    /// every job is taken in order.
    pub worker: Option<WorkerId>,
    /// How long others go before a job because the worker knows their sessions.
    pub patience: Duration,
    /// What the job is from then on.
    pub to: JobState,
    /// How long it is the worker's, until it is renewed.
    pub lease: Duration,
}

impl Claim {
    /// How long a job waits for the worker that knows its session: little to one who waits, enough for one that is free.
    pub const HEAD_START: Duration = Duration::from_secs(1);
    /// A usual patience. When all workers are busy every job has waited for longer than the head start; were they taken in the order of
    /// their numbers then, each worker would make the fields and meshes of all sessions again, just when there is too much to do.
    pub const PATIENCE: Duration = Duration::from_secs(60);
}

/// What became of a job that was to be stored.
#[derive(Debug, Clone, PartialEq)]
pub enum Insertion {
    /// It is stored.
    Stored {
        /// Jobs that made room for it, with their milestones, which no row names any more.
        superseded: Vec<(JobId, Option<String>)>,
        /// Jobs that wait before it in its lane.
        before: u32,
    },
    /// The session has a job that was asked for the same, has not ended and was not asked to stop; and the jobs that wait before
    /// it, when it waits.
    Twin(Box<JobRecord>, Option<u32>),
    /// Too many jobs wait in all.
    Full,
    /// Too many jobs of the tenant wait.
    TenantFull,
}

/// The warnings of a row with `new` ones, each once.
pub(super) fn joined_warnings(mut warnings: Vec<String>, new: &[String]) -> Vec<String> {
    for warning in new {
        if !warnings.contains(warning) {
            warnings.push(warning.clone());
        }
    }
    warnings
}

/// Progress after a change to `to`.
pub(super) fn progress_after(to: JobState, change: Option<f64>, before: f64) -> f64 {
    match to {
        JobState::Succeeded => 1.0,
        JobState::Accepted => 0.0,
        JobState::Running | JobState::Failed | JobState::Cancelled | JobState::Interrupted => change.unwrap_or(before),
    }
}

/// Refuses what would take a session above its quota.
pub(super) fn check_quota(bytes: u64, quota: u64) -> Result<(), StoreError> {
    if bytes > quota { Err(StoreError::QuotaFull { allowed: quota }) } else { Ok(()) }
}
