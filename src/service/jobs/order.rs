use prosopon_store::{JobKind, SessionId};

/// A job that is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Order {
    /// Session that it belongs to.
    pub session: SessionId,
    /// What it makes.
    pub kind: JobKind,
    /// Steps that it will hand out.
    pub steps: u32,
    /// What is asked for, JSON.
    pub request: String,
    /// What it is about, where a newer job may take its place.
    pub subject: Option<String>,
    /// Whether it takes the place of waiting jobs about the same.
    pub supersede: bool,
    /// Another session that it reads.
    pub other_session: Option<SessionId>,
    /// Longest time that it may compute, s; the service's when absent.
    pub max_wall_s: Option<f64>,
}

impl Order {
    /// A job without steps and options.
    #[must_use]
    pub fn new(session: SessionId, kind: JobKind, request: String) -> Self {
        Self {
            session,
            kind,
            steps: 0,
            request,
            subject: None,
            supersede: false,
            other_session: None,
            max_wall_s: None,
        }
    }
}
