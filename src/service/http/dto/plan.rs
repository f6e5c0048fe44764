use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use prosopon_contract::PlanDocument;
use prosopon_store::PlanRecord;

/// A stored plan with the report on its paths.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanView {
    /// Id of the plan.
    pub id: Uuid,
    /// Id of the osteotomy whose segments move; absent if they belong to an uploaded tissue mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub osteotomy: Option<Uuid>,
    /// When the plan was created (RFC 3339).
    pub created_at: String,
    /// Paths, and the overlaps and gaps of bone along them.
    #[serde(flatten)]
    pub content: PlanDocument,
}

impl PlanView {
    pub(in crate::http) fn new(record: &PlanRecord, content: PlanDocument) -> Self {
        Self {
            id: record.id.uuid(),
            osteotomy: record.osteotomy.map(|o| o.uuid()),
            created_at: record.created_at.clone(),
            content,
        }
    }
}

/// All plans of a session, oldest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanList {
    /// The session's plans.
    pub plans: Vec<PlanView>,
}
