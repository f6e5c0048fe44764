use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use prosopon_contract::OsteotomyDocument;
use prosopon_store::OsteotomyRecord;

/// A stored osteotomy: its cuts and the segments they make.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OsteotomyView {
    /// Id of the osteotomy.
    pub id: Uuid,
    /// When the osteotomy was created (RFC 3339).
    pub created_at: String,
    /// Computing time of the cut, s.
    pub wall_s: f64,
    /// Whether bone or field settings have changed since the cut; if so, cut again.
    pub stale: bool,
    /// Cuts, segments and warnings.
    #[serde(flatten)]
    pub content: OsteotomyDocument,
}

impl OsteotomyView {
    pub(in crate::http) fn new(record: &OsteotomyRecord, content: OsteotomyDocument, field_key: Option<&str>) -> Self {
        Self {
            id: record.id.uuid(),
            created_at: record.created_at.clone(),
            wall_s: record.wall_s,
            stale: field_key != Some(record.field_key.as_str()),
            content,
        }
    }
}

/// All osteotomies of a session, oldest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OsteotomyList {
    /// The session's osteotomies.
    pub osteotomies: Vec<OsteotomyView>,
}
