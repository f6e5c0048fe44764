use super::{SessionId, TenantId};

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
