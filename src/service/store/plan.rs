use super::{OsteotomyId, PlanId, SessionId};

/// The row of an osteotomy: cuts and the bone segments that they make.
#[derive(Debug, Clone, PartialEq)]
pub struct OsteotomyRecord {
    /// Its id.
    pub id: OsteotomyId,
    /// Its session.
    pub session: SessionId,
    /// Key of the distance field that the cuts were made in.
    pub field_key: String,
    /// Computing time of the cut, s.
    pub wall_s: f64,
    /// Size of its blobs, bytes.
    pub bytes: u64,
    /// Cuts and segments, JSON.
    pub document: String,
    /// Blobs of the segments' surfaces, in the order of the segments.
    pub blobs: Vec<String>,
    /// When it was created, RFC 3339.
    pub created_at: String,
}

/// The row of a plan: the paths of the bone segments.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlanRecord {
    /// Its id.
    pub id: PlanId,
    /// Its session.
    pub session: SessionId,
    /// Osteotomy whose segments move; `None` when the plan moves the segments of an uploaded tissue mesh.
    pub osteotomy: Option<OsteotomyId>,
    /// Paths and their reports, JSON.
    pub document: String,
    /// When it was created, RFC 3339.
    pub created_at: String,
}
