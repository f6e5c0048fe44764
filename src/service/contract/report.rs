use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::warning::Findings;
use super::{
    AttachedDocument, BudgetDocument, ClinicalDocument, ErrorDocument, FieldDocument, FrameDocument, LeftOutDocument,
    MeshDocument, PlanDocument, RegionMotionDocument, StepDocument, TissueDocument,
};

/// Computing time of each phase, s; all but `solve_s` are from when the parts were made.
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
    /// Following the bone along its path, with overlaps and gaps.
    pub plan_s: f64,
    /// The steps.
    pub solve_s: f64,
    /// Sum of all phases.
    pub total_s: f64,
}

/// Hashes of an input of the result.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ReportInput {
    /// SHA-256 of the stored part.
    pub sha256: String,
    /// SHA-256 of the file that it came from.
    pub source_sha256: Option<String>,
}

/// Report of a finished job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReportDocument {
    /// Version of the layout of this document.
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
    #[schema(value_type = Object)]
    pub parameters: serde_json::Value,
    /// Input parts by name.
    pub inputs: BTreeMap<String, ReportInput>,
    /// Computing time of each phase.
    pub phases: PhasesDocument,
    /// The distance fields; absent for an uploaded tissue mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub field: Option<FieldDocument>,
    /// The tissue mesh; absent for an uploaded tissue mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<MeshDocument>,
    /// The uploaded tissue mesh that replaces it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tissue: Option<TissueDocument>,
    /// What `auto` chose for the request's budget; absent without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub budget: Option<BudgetDocument>,
    /// Plan with the paths of the bone.
    pub plan: PlanDocument,
    /// Names of the bone segments by number, as the osteotomy suggested them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub segment_names: BTreeMap<u32, String>,
    /// Cost and result of each step.
    pub steps: Vec<StepDocument>,
    /// Tissue that was left out; absent when all was kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left_out: Option<LeftOutDocument>,
    /// Numbers of tied, sliding and free nodes.
    ///
    /// Absent for an uploaded tissue mesh, whose description has them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attached: Option<AttachedDocument>,
    /// Mean movement of the regions of the face at the end of the path.
    pub regions: BTreeMap<String, RegionMotionDocument>,
    /// The prediction in a surgeon's terms; absent for an uploaded tissue mesh and in old records.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clinical: Option<ClinicalDocument>,
    /// Error of the last step, when there is a reference.
    pub error: Option<ErrorDocument>,
    /// Whether landmarks placed the regions of the face; otherwise the proportions of the skin did.
    pub regions_from_landmarks: bool,
    /// Frame of the head: forward, down and left of this report are its directions. Absent in reports of earlier versions and for
    /// uploaded tissue meshes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<FrameDocument>,
    /// Proposed landmarks and planes of the session that no person has confirmed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unconfirmed_landmarks: Vec<String>,
    /// Warnings and notes.
    #[serde(flatten)]
    pub findings: Findings,
}
