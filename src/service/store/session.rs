use super::{JobRecord, OsteotomyId, PartRecord, PlanId, SessionId, TenantId};

/// A session's row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SessionRecord {
    /// Its id.
    pub id: SessionId,
    /// Whose it is.
    pub tenant: TenantId,
    /// The client's opaque tag.
    pub label: Option<String>,
    /// Settings document, JSON.
    pub settings: String,
    /// When it was made, RFC 3339.
    pub created_at: String,
}

/// Whose a session or job is, or was.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Owner {
    /// The tenant.
    pub tenant: TenantId,
    /// Whether the thing was deleted.
    pub deleted: bool,
}

/// What a session holds, as lists show it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SessionContents {
    /// Its parts.
    pub parts: Vec<PartRecord>,
    /// Its osteotomies, oldest first.
    pub osteotomies: Vec<OsteotomyId>,
    /// Its plans, oldest first.
    pub plans: Vec<PlanId>,
    /// Its jobs, newest first, at most so many as were asked for.
    pub jobs: Vec<JobRecord>,
    /// Bytes stored for it.
    pub bytes: u64,
}
