use super::{OsteotomyId, PlanId, SessionId};

/// Cuts and their bone segments.
#[derive(Debug, Clone, PartialEq)]
pub struct OsteotomyRecord {
    /// Its id.
    pub id: OsteotomyId,
    /// Its session.
    pub session: SessionId,
    /// Key of the field that it was cut from.
    pub field_key: String,
    /// Time that the cut took, s.
    pub wall_s: f64,
    /// Bytes stored.
    pub bytes: u64,
    /// Cuts and segments, JSON.
    pub document: String,
    /// Blobs of the segments' surfaces, by segment.
    pub blobs: Vec<String>,
    /// When it was made, RFC 3339.
    pub created_at: String,
}

/// Bone paths.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlanRecord {
    /// Its id.
    pub id: PlanId,
    /// Its session.
    pub session: SessionId,
    /// Whose segments move; those of the session's tissue mesh when absent.
    pub osteotomy: Option<OsteotomyId>,
    /// Paths and their report, JSON.
    pub document: String,
    /// When it was made, RFC 3339.
    pub created_at: String,
}
