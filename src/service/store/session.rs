use super::{JobRecord, OsteotomyId, PartRecord, PlanId, SessionId, TenantId};

/// The row of a session.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SessionRecord {
    /// Its id.
    pub id: SessionId,
    /// Its tenant.
    pub tenant: TenantId,
    /// Label that the client gave it.
    pub label: Option<String>,
    /// Settings document, JSON.
    pub settings: String,
    /// When it was created, RFC 3339.
    pub created_at: String,
}

/// Owner of a session or job, which may be deleted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Owner {
    /// The tenant.
    pub tenant: TenantId,
    /// Whether the session or job was deleted or hidden.
    pub deleted: bool,
}

/// Contents of a session, as lists show them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SessionContents {
    /// Its parts.
    pub parts: Vec<PartRecord>,
    /// Its osteotomies, oldest first.
    pub osteotomies: Vec<OsteotomyId>,
    /// Its plans, oldest first.
    pub plans: Vec<PlanId>,
    /// Its newest jobs, newest first, up to the number requested.
    pub jobs: Vec<JobRecord>,
    /// Bytes stored for the session.
    pub bytes: u64,
}
