use prosopon_store::{JobKind, SessionId, SupersedeScope};

/// Order of a new job.
#[derive(Debug, Clone, PartialEq)]
pub struct Order {
    /// Session of the job.
    pub session: SessionId,
    /// Kind of the job.
    pub kind: JobKind,
    /// Number of steps that a solve produces; 0 for other kinds.
    pub steps: u32,
    /// The request, JSON.
    pub request: String,
    /// Subject, for example the id of a plan; a newer job with the same subject may supersede this one.
    pub subject: Option<String>,
    /// Which waiting jobs of the session and kind the job supersedes; none when `None`.
    pub supersede: Option<SupersedeScope>,
    /// Another session that the job reads.
    pub other_session: Option<SessionId>,
    /// Longest computing time, s; the service's limit when `None`.
    pub max_wall_s: Option<f64>,
}

impl Order {
    /// An order without steps and options.
    #[must_use]
    pub fn new(session: SessionId, kind: JobKind, request: String) -> Self {
        Self { session, kind, steps: 0, request, subject: None, supersede: None, other_session: None, max_wall_s: None }
    }
}
