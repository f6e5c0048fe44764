use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::PartView;
use prosopon_contract::MeshDocument;

/// The tissue mesh of a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MeshView {
    /// State, size and build time.
    #[serde(flatten)]
    pub part: PartView,
    /// Quality report of the last build; `null` before the first build.
    pub report: Option<MeshDocument>,
}
