use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{
    AttachedDocument, ErrorDocument, FieldDocument, LeftOutDocument, MeshDocument, PlanDocument, RegionMotionDocument,
    StepDocument, TissueDocument,
};

/// Time by phase, s. All but the steps were taken when the parts were made.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, ToSchema)]
pub struct PhasesDocument {
    /// Import, surfaces included.
    pub surfaces_s: f64,
    /// Distance fields.
    pub field_s: f64,
    /// Cutting the bone.
    pub cut_s: f64,
    /// Tissue mesh.
    pub mesh_s: f64,
    /// Following the bone along its path, overlap and gap.
    pub plan_s: f64,
    /// The steps.
    pub solve_s: f64,
    /// Sum of all.
    pub total_s: f64,
}

/// An input that the result depends on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ReportInput {
    /// SHA-256 of the stored part.
    pub sha256: String,
    /// SHA-256 of the file that it came from.
    pub source_sha256: Option<String>,
}

/// Everything worth keeping about a finished job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReportDocument {
    /// Layout of this document.
    pub format_version: u32,
    /// Version of the software.
    pub version: String,
    /// The job.
    pub job: String,
    /// Its session.
    pub session: String,
    /// When it ended, RFC 3339.
    pub finished_at: String,
    /// Attempt that succeeded.
    pub attempt: u32,
    /// Mechanical model that was used.
    pub model: String,
    /// Steps, materials and attachment as used.
    pub parameters: serde_json::Value,
    /// Input parts by name.
    pub inputs: BTreeMap<String, ReportInput>,
    /// Time by phase.
    pub phases: PhasesDocument,
    /// The distance fields; absent for a ready mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub field: Option<FieldDocument>,
    /// The tissue mesh; absent for a ready mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<MeshDocument>,
    /// The ready mesh that took its place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tissue: Option<TissueDocument>,
    /// Where the bone went.
    pub plan: PlanDocument,
    /// What each step needed and reached.
    pub steps: Vec<StepDocument>,
    /// Tissue that was left out; absent where all was kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left_out: Option<LeftOutDocument>,
    /// How many nodes were tied, slid or were free; absent for a ready mesh, whose file says it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attached: Option<AttachedDocument>,
    /// Mean movement of the parts of the face at the end of the path.
    pub regions: BTreeMap<String, RegionMotionDocument>,
    /// Error of the last step, where there is something to compare with.
    pub error: Option<ErrorDocument>,
    /// Whether landmarks placed the regions of the face (else the proportions of the skin did).
    pub regions_from_landmarks: bool,
    /// Landmarks and planes of the session that were proposed and that no person has confirmed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unconfirmed_landmarks: Vec<String>,
    /// What a reader should know.
    pub warnings: Vec<String>,
}
