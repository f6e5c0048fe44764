//! Requests of jobs, as stored in their rows.

use serde::{Deserialize, Serialize};

use super::{PhysicsRecord, RegisterOn};
use prosopon_geometry::{Aabb, Point, TriMesh};
use prosopon_planning::evaluate::{Mask, MaskRegion};
use prosopon_planning::plan::PlanError;
use prosopon_planning::simulate::{AttachmentRules, RunSettings, SkullPaint};
use prosopon_planning::surface::CtSettings;
use prosopon_session::{
    BoxDocument, CutDocument, Earlier, Fault, FaultKind, FieldSettingsDocument, MeshSettingsDocument, NodeClassName,
    PaintDocument, PlanDocument, PresetName, TissueDocument,
};
use prosopon_store::{JobId, OsteotomyId, PlanId, SessionId};

/// Request of an import: skin, skull, air and soft tissue from a CT.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ImportRequest {
    /// SHA-256 of the CT.
    pub ct_sha256: String,
    /// Threshold of the skin, HU.
    pub skin_hu: f64,
    /// Threshold of bone, HU.
    pub bone_hu: f64,
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
pub struct FieldRequest {
    /// Settings of the fields.
    pub settings: FieldSettingsDocument,
    /// Key of the inputs and settings when the job was accepted.
    pub key: String,
}

/// Request of the tissue mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MeshRequest {
    /// Settings of the mesh.
    pub settings: MeshSettingsDocument,
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

/// Rules for which inner nodes are tied to bone and which slide.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AttachmentRecord {
    /// Boundary nodes nearer to bone than this are tied, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tie_gap_mm: Option<f64>,
    /// Boxes in which nodes near bone slide.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sliding: Option<Vec<BoxDocument>>,
    /// Node classes painted in boxes and balls.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub paint: Vec<PaintDocument>,
    /// Node classes painted on the skull's vertices, one entry for each vertex.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skull_classes: Option<Vec<Option<NodeClassName>>>,
}

impl AttachmentRecord {
    /// The rules for the numerics.
    ///
    /// # Errors
    /// [`FaultKind::InvalidRequest`] when the number of painted vertices is not that of the `skull`.
    pub fn rules(&self, skull: &TriMesh) -> Result<AttachmentRules, Fault> {
        let skull = self.skull_classes.as_ref().map(|classes| {
            let (found, needed) = (classes.len(), skull.positions().len());
            if found != needed {
                let detail = format!("has {found} classes, but the skull has {needed} vertices; give one class for each vertex");
                return Err(Fault::new(FaultKind::InvalidRequest, detail).at("/attachment/skull_classes"));
            }
            let classes = classes.iter().map(|c| c.map(Into::into)).collect();
            Ok(SkullPaint { positions: skull.positions().to_vec(), classes })
        });
        Ok(AttachmentRules {
            tie_gap_mm: self.tie_gap_mm,
            sliding: self.sliding.as_ref().map(|boxes| boxes.iter().map(Aabb::from).collect()),
            skull: skull.transpose()?,
            paint: self.paint.iter().filter_map(PaintDocument::paint).collect(),
        })
    }
}

/// The tissue mesh of a solve, which is built when it is not stored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MeshChoice {
    /// Settings of the mesh.
    pub settings: MeshSettingsDocument,
    /// Cuts whose segments determine the meshed region; `None` for the front of the face or a box.
    pub cuts: Option<Vec<CutDocument>>,
}

/// Request of a solve along a plan.
///
/// It holds copies of the plan and the mesh settings, because the job may outlive them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SolveRequest {
    /// The plan's id.
    pub plan_id: PlanId,
    /// Its osteotomy's id.
    pub osteotomy_id: OsteotomyId,
    /// The plan.
    pub plan: PlanDocument,
    /// Cuts of the plan's osteotomy.
    pub cuts: Vec<CutDocument>,
    /// Computing time of the cut, s.
    pub cut_s: f64,
    /// Warnings of the cuts.
    pub cut_warnings: Vec<String>,
    /// The tissue mesh.
    pub mesh: MeshChoice,
    /// Key of the mesh when the job was accepted.
    pub mesh_key: String,
    /// Model, elements, materials.
    #[serde(flatten)]
    pub physics: PhysicsRecord,
    /// Number of steps.
    pub steps: u32,
    /// Attachment rules; derived from the landmarks when `None`.
    pub attachment: Option<AttachmentRecord>,
    /// Whether error maps are computed when there is a reference.
    pub error_maps: bool,
    /// Whether the deformed volume is stored.
    pub tissue: bool,
    /// Job to compare with when the session has no target surface.
    pub reference_job: Option<JobId>,
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
pub struct SceneRequest {
    /// Description of the mesh when the job was accepted.
    pub ready: TissueDocument,
    /// The plan's id.
    pub plan_id: PlanId,
    /// The plan.
    pub plan: PlanDocument,
    /// Id of the plan's osteotomy, if it has one.
    pub osteotomy_id: Option<OsteotomyId>,
    /// Cuts of the plan's osteotomy, whose segments the mesh is in contact with.
    pub cuts: Option<Vec<CutDocument>>,
    /// Key of the fields in which the cuts were made; empty without cuts.
    pub field_key: String,
    /// Warnings of the cuts.
    pub cut_warnings: Vec<String>,
    /// Segments and part keys of the uploaded bones.
    pub bones: Vec<(u32, String)>,
    /// Settings of the distance fields of the bones.
    pub field_settings: FieldSettingsDocument,
    /// Model, elements, materials.
    pub physics: PhysicsRecord,
    /// Number of steps.
    pub steps: u32,
    /// Whether the solved mesh is stored as a VTU file.
    pub file: bool,
}

/// Distinguishes the request of a scene from that of a patient case: only a scene has `ready`.
#[derive(Debug, Deserialize)]
pub(super) struct SolveKind {
    #[serde(default)]
    pub(super) ready: Option<serde::de::IgnoredAny>,
}

impl SolveRequest {
    /// Solver settings for the numerics, for the patient's `skull`.
    ///
    /// # Errors
    /// As [`AttachmentRecord::rules`].
    pub fn settings(&self, skull: &TriMesh) -> Result<RunSettings, Fault> {
        Ok(RunSettings {
            solver: (&self.physics).into(),
            steps: self.steps as usize,
            attachment: self.attachment.as_ref().map(|a| a.rules(skull)).transpose()?,
            leave_out_below_mm: self.physics.leave_out_below_mm,
        })
    }
}

/// A stored surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SurfaceSource {
    /// Outer skin of a session.
    Skin(SessionId),
    /// Bone of a session.
    Skull(SessionId),
    /// Post-operative skin of a session.
    Target(SessionId),
    /// Skin of a solve at a step: job and step number.
    Step(JobId, u32),
}

/// A part of space.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PartShape {
    /// A box.
    Box(BoxDocument),
    /// A ball: centre and radius, mm.
    Ball([f64; 3], f64),
}

/// Mask: the vertices of a surface that count.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct MaskRecord {
    /// Only vertices in one of these parts of space; all when empty.
    pub only: Vec<PartShape>,
    /// Only vertices that are true here, one entry for each vertex.
    pub vertices: Option<Vec<bool>>,
    /// No vertices in one of these parts of space.
    pub except: Vec<PartShape>,
}

/// Rigid registration before a comparison.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RegisterRecord {
    /// Vertices that the registration uses.
    pub region: MaskRecord,
    /// Vertices that a job moves by less than this count as unmoved, mm.
    pub threshold_mm: f64,
}

/// Request of a comparison of two surfaces.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CompareRecord {
    /// The predicted surface.
    pub prediction: SurfaceSource,
    /// The reference surface.
    pub reference: SurfaceSource,
    /// Keys of the prediction and the reference when the job was accepted.
    pub keys: [String; 2],
    /// Vertices of the prediction that count.
    pub mask: MaskRecord,
    /// Parts of space that are left out of the comparison and of the registration.
    pub exclude: Vec<PartShape>,
    /// Whether the eyes are left out too.
    #[serde(default)]
    pub exclude_eyes: bool,
    /// Registration before the comparison, if requested.
    pub register: Option<RegisterRecord>,
}

impl From<&MaskRegion> for PartShape {
    fn from(part: &MaskRegion) -> Self {
        match part {
            MaskRegion::Box(bounds) => Self::Box(BoxDocument { min_mm: bounds.min.into(), max_mm: bounds.max.into() }),
            MaskRegion::Ball { centre, radius_mm } => Self::Ball((*centre).into(), *radius_mm),
        }
    }
}

impl From<&PartShape> for MaskRegion {
    fn from(shape: &PartShape) -> Self {
        match shape {
            PartShape::Box(bounds) => Self::Box(bounds.into()),
            PartShape::Ball(centre, radius_mm) => Self::Ball { centre: Point::from(*centre), radius_mm: *radius_mm },
        }
    }
}

impl From<&Mask> for MaskRecord {
    fn from(mask: &Mask) -> Self {
        Self {
            only: mask.only.iter().map(PartShape::from).collect(),
            vertices: mask.vertices.clone(),
            except: mask.except.iter().map(PartShape::from).collect(),
        }
    }
}

impl From<&MaskRecord> for Mask {
    fn from(record: &MaskRecord) -> Self {
        Self {
            only: record.only.iter().map(MaskRegion::from).collect(),
            vertices: record.vertices.clone(),
            except: record.except.iter().map(MaskRegion::from).collect(),
        }
    }
}

impl From<&RegisterOn> for RegisterRecord {
    fn from(on: &RegisterOn) -> Self {
        Self { region: (&on.region).into(), threshold_mm: on.threshold_mm }
    }
}

impl From<&RegisterRecord> for RegisterOn {
    fn from(record: &RegisterRecord) -> Self {
        Self { region: (&record.region).into(), threshold_mm: record.threshold_mm }
    }
}
