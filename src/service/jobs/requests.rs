//! Requests of jobs, as stored in their rows.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use prosopon_contract::{
    BudgetDocument, CompareRequest, CutDocument, Fault, FieldSettingsDocument, MeshRequest, PlanDocument, PresetName,
    SolveRequest, TissueDocument, WarningDocument,
};
use prosopon_geometry::TriMesh;
use prosopon_planning::plan::PlanError;
use prosopon_planning::simulate::{HEAD_LOCKING, RunSettings};
use prosopon_planning::surface::CtSettings;
use prosopon_session::Earlier;
use prosopon_store::{JobId, JobRecord, OsteotomyId};

/// Request of an import: skin, skull, air and soft tissue from a CT.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ImportRequest {
    /// SHA-256 of the CT.
    pub ct_sha256: String,
    /// Threshold of the skin in the units of the volume; `None` when the volume's own levels determine it.
    #[serde(default)]
    pub skin_hu: Option<f64>,
    /// Threshold of bone in the units of the volume; `None` when the volume's own levels determine it.
    #[serde(default)]
    pub bone_hu: Option<f64>,
    /// Largest geometric error of the simplified surfaces, mm.
    pub max_error_mm: f64,
}

impl From<&ImportRequest> for CtSettings {
    fn from(r: &ImportRequest) -> Self {
        Self { skin_hu: r.skin_hu, bone_hu: r.bone_hu, max_error_mm: r.max_error_mm }
    }
}

/// Request of the distance fields.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FieldTask {
    /// Settings of the fields.
    pub settings: FieldSettingsDocument,
    /// Key of the inputs and settings when the job was accepted.
    pub key: String,
}

/// Request of the tissue mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MeshTask {
    /// Settings of the mesh.
    pub settings: MeshRequest,
    /// Cuts whose segments determine the meshed region.
    pub cuts: Option<Vec<CutDocument>>,
    /// Osteotomy of the cuts.
    #[serde(default)]
    pub osteotomy_id: Option<OsteotomyId>,
    /// Material preset whose stability the mesh job checks.
    #[serde(default)]
    pub preset: PresetName,
    /// Key of the inputs and settings when the job was accepted.
    pub key: String,
}

/// The tissue mesh of a solve, which is built when it is not stored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MeshChoice {
    /// Settings of the mesh.
    pub settings: MeshRequest,
    /// Cuts whose segments determine the meshed region; `None` for the front of the face or a box.
    pub cuts: Option<Vec<CutDocument>>,
}

/// What a request gives, so that a budget does not choose it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Given {
    /// The mesh.
    pub mesh: bool,
    /// The formulation.
    pub locking: bool,
}

/// Request of a solve along a plan.
///
/// It holds copies of the plan and the mesh settings, because the job may outlive them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SolveTask {
    /// The request with all defaults filled in; its plan is `plan`.
    pub request: SolveRequest,
    /// Its osteotomy's id.
    pub osteotomy_id: OsteotomyId,
    /// The plan.
    pub plan: PlanDocument,
    /// Cuts of the plan's osteotomy.
    pub cuts: Vec<CutDocument>,
    /// Computing time of the cut, s.
    pub cut_s: f64,
    /// Warnings of the cuts.
    pub cut_warnings: Vec<WarningDocument>,
    /// Names of the segments, by number.
    #[serde(default)]
    pub segment_names: BTreeMap<u32, String>,
    /// The tissue mesh.
    pub mesh: MeshChoice,
    /// Key of the mesh when the job was accepted.
    pub mesh_key: String,
    /// What was chosen for the request's budget.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub budget: Option<BudgetDocument>,
    /// What the request gave, so that a budget does not choose it.
    #[serde(default)]
    pub given: Given,
    /// SHA-256 of the session's target surface when the job was accepted.
    #[serde(default)]
    pub target: Option<String>,
    /// Job from whose end state this solve starts; `None` starts from rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub warm_start: Option<Box<EarlierSolve>>,
}

/// An earlier solve from whose end state a solve starts.
///
/// It holds a copy of the plan, because the later job may outlive the earlier one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EarlierSolve {
    /// The earlier job.
    pub job: JobId,
    /// Its plan.
    pub plan: PlanDocument,
    /// Its number of steps.
    pub steps: u32,
    /// Solve from whose end state the earlier job started.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub warm_start: Option<Box<EarlierSolve>>,
}

impl EarlierSolve {
    /// Length of the chain of earlier jobs down to one that started from rest.
    #[must_use]
    pub fn depth(&self) -> usize {
        1 + self.warm_start.as_ref().map_or(0, |before| before.depth())
    }

    /// The earlier solve for the numerics.
    ///
    /// # Errors
    /// As [`PlanDocument::plan`].
    pub fn earlier(&self) -> Result<Earlier, PlanError> {
        let after = self.warm_start.as_ref().map(|before| before.earlier()).transpose()?;
        Ok(Earlier { plan: self.plan.plan()?, steps: self.steps as usize, after: after.map(Box::new) })
    }
}

/// Request of a solve with an uploaded tissue mesh (a scene).
///
/// It holds a copy of the plan, because the job may outlive it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneTask {
    /// Description of the mesh when the job was accepted.
    pub ready: TissueDocument,
    /// The request with all defaults filled in; its plan is `plan`.
    pub request: SolveRequest,
    /// The plan.
    pub plan: PlanDocument,
    /// Id of the plan's osteotomy, if it has one.
    pub osteotomy_id: Option<OsteotomyId>,
    /// Cuts of the plan's osteotomy, whose segments the mesh is in contact with.
    pub cuts: Option<Vec<CutDocument>>,
    /// Key of the fields in which the cuts were made; empty without cuts.
    pub field_key: String,
    /// Warnings of the cuts.
    pub cut_warnings: Vec<WarningDocument>,
    /// Names of the segments of the cuts, by number.
    #[serde(default)]
    pub segment_names: BTreeMap<u32, String>,
    /// Segments and part keys of the uploaded bones.
    pub bones: Vec<(u32, String)>,
    /// Settings of the distance fields of the bones.
    pub field_settings: FieldSettingsDocument,
}

/// Distinguishes the request of a scene from that of a patient case: only a scene has `ready`.
#[derive(Debug, Deserialize)]
pub(super) struct SolveKind {
    #[serde(default)]
    pub(super) ready: Option<serde::de::IgnoredAny>,
}

impl SolveTask {
    /// The request of a stored solve on a patient's head.
    ///
    /// # Errors
    /// Why there is none: the job solved an uploaded mesh, or an earlier version accepted it.
    pub fn of(job: &JobRecord) -> Result<Self, &'static str> {
        serde_json::from_str(&job.request).map_err(|_| match serde_json::from_str::<SolveKind>(&job.request) {
            Ok(SolveKind { ready: Some(_) }) => "solved an uploaded tissue mesh",
            Ok(_) | Err(_) => "was solved by an earlier version",
        })
    }

    /// Solver settings for the numerics, for the patient's `skull`.
    ///
    /// # Errors
    /// As [`prosopon_contract::Attachment::rules`].
    pub fn settings(&self, skull: &TriMesh) -> Result<RunSettings, Fault> {
        Ok(RunSettings {
            solver: self.request.options().settings(HEAD_LOCKING),
            steps: self.request.steps() as usize,
            attachment: self.request.attachment.as_ref().map(|a| a.rules(skull)).transpose()?,
            leave_out_below_mm: self.request.leave_out_below_mm(),
        })
    }
}

/// Comparison of two surfaces. The keys name their contents at the time of the request.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CompareTask {
    /// The request.
    pub request: CompareRequest,
    /// Keys of prediction and reference.
    pub keys: [String; 2],
}
