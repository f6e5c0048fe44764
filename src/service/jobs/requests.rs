//! What a job was asked to do, as stored in its row.

use serde::{Deserialize, Serialize};

use super::{PhysicsRecord, RegisterOn};
use prosopon_geometry::{Aabb, Point, TriMesh};
use prosopon_planning::evaluate::{Mask, Part};
use prosopon_planning::plan::PlanError;
use prosopon_planning::simulate::{AttachmentRules, RunSettings, SkullPaint};
use prosopon_planning::surface::CtSettings;
use prosopon_session::{
    BoxDocument, CutDocument, Earlier, Fault, FaultKind, FieldSettingsDocument, MeshSettingsDocument, NodeClassName,
    PaintDocument, PlanDocument, PresetName, TissueDocument,
};
use prosopon_store::{JobId, OsteotomyId, PlanId, SessionId};

/// Skin and skull from a CT.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ImportRequest {
    /// SHA-256 of the CT.
    pub ct_sha256: String,
    /// Skin level, HU.
    pub skin_hu: f64,
    /// Bone level, HU.
    pub bone_hu: f64,
    /// Geometric error allowed when surfaces are simplified, mm.
    pub max_error_mm: f64,
}

impl From<&ImportRequest> for CtSettings {
    fn from(r: &ImportRequest) -> Self {
        Self { skin_hu: r.skin_hu, bone_hu: r.bone_hu, max_error_mm: r.max_error_mm }
    }
}

/// Distance fields.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FieldRequest {
    /// Settings.
    pub settings: FieldSettingsDocument,
    /// Key of the inputs and settings at the time of asking.
    pub key: String,
}

/// Tissue mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MeshRequest {
    /// Settings.
    pub settings: MeshSettingsDocument,
    /// Cuts whose segments choose the region.
    pub cuts: Option<Vec<CutDocument>>,
    /// The osteotomy that they come from.
    #[serde(default)]
    pub osteotomy_id: Option<OsteotomyId>,
    /// Materials of the session's jobs.
    #[serde(default)]
    pub preset: PresetName,
    /// Key of the inputs and settings at the time of asking.
    pub key: String,
}

/// Which inner nodes are tied to bone, which slide.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AttachmentRecord {
    /// Boundary nodes nearer to bone than this are tied, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tie_gap_mm: Option<f64>,
    /// Boxes in which nodes slide instead.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sliding: Option<Vec<BoxDocument>>,
    /// Classes painted in parts of space.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub paint: Vec<PaintDocument>,
    /// Classes painted on the skull's vertices.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skull_classes: Option<Vec<Option<NodeClassName>>>,
}

impl AttachmentRecord {
    /// As the numerics take it.
    ///
    /// # Errors
    /// Painted vertices that are not those of the `skull`.
    pub fn rules(&self, skull: &TriMesh) -> Result<AttachmentRules, Fault> {
        let skull = self.skull_classes.as_ref().map(|classes| {
            let (found, needed) = (classes.len(), skull.positions().len());
            if found != needed {
                let detail = format!("has {found} classes, the skull has {needed} vertices");
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

/// The tissue mesh that a solve takes, or builds where it is not there.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MeshChoice {
    /// Settings.
    pub settings: MeshSettingsDocument,
    /// Cuts whose segments choose the region: those of the solve; absent when it is the front of the face or a box.
    pub cuts: Option<Vec<CutDocument>>,
}

/// Deformed skin along a plan. Holds copies of plan and mesh settings: the job outlives them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SolveRequest {
    /// The plan's id.
    pub plan_id: PlanId,
    /// Its osteotomy's id.
    pub osteotomy_id: OsteotomyId,
    /// The plan.
    pub plan: PlanDocument,
    /// Cuts of its osteotomy.
    pub cuts: Vec<CutDocument>,
    /// Time that the cut took, s.
    pub cut_s: f64,
    /// What is doubtful about the cuts.
    pub cut_warnings: Vec<String>,
    /// The mesh.
    pub mesh: MeshChoice,
    /// Key of the mesh at the time of asking.
    pub mesh_key: String,
    /// Model, elements, materials.
    #[serde(flatten)]
    pub physics: PhysicsRecord,
    /// Steps.
    pub steps: u32,
    /// Attachment; chosen from the landmarks when absent.
    pub attachment: Option<AttachmentRecord>,
    /// Whether error maps are made where there is something to compare with.
    pub error_maps: bool,
    /// Whether the deformed volume is kept.
    pub tissue: bool,
    /// Job to compare with when the session has no target.
    pub reference_job: Option<JobId>,
    /// SHA-256 of the session's target at the time of asking.
    #[serde(default)]
    pub target: Option<String>,
    /// The job at whose end this one begins.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub warm_start: Option<Box<EarlierSolve>>,
}

/// What a solve needs to know of an earlier one to begin at its end. Holds a copy of the plan: it may outlive that job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EarlierSolve {
    /// That job.
    pub job: JobId,
    /// Its plan.
    pub plan: PlanDocument,
    /// Its steps.
    pub steps: u32,
    /// What it began at itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub warm_start: Option<Box<EarlierSolve>>,
}

impl EarlierSolve {
    /// How many jobs, each begun at the end of the next, it takes to come to rest.
    #[must_use]
    pub fn depth(&self) -> usize {
        1 + self.warm_start.as_ref().map_or(0, |before| before.depth())
    }

    /// As the numerics take it.
    ///
    /// # Errors
    /// [`PlanDocument::plan`].
    pub fn earlier(&self) -> Result<Earlier, PlanError> {
        let after = self.warm_start.as_ref().map(|before| before.earlier()).transpose()?;
        Ok(Earlier { plan: self.plan.plan()?, steps: self.steps as usize, after: after.map(Box::new) })
    }
}

/// A ready tissue mesh moved along a plan. Holds a copy of the plan: the job outlives it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneRequest {
    /// The mesh, as it was at the time of asking.
    pub ready: TissueDocument,
    /// The plan's id.
    pub plan_id: PlanId,
    /// The plan.
    pub plan: PlanDocument,
    /// Its osteotomy's id, where it has one.
    pub osteotomy_id: Option<OsteotomyId>,
    /// Cuts of its osteotomy, whose segments the mesh touches.
    pub cuts: Option<Vec<CutDocument>>,
    /// Key of the fields that were cut; empty without cuts.
    pub field_key: String,
    /// What is doubtful about the cuts.
    pub cut_warnings: Vec<String>,
    /// Segments and keys of the uploaded bones.
    pub bones: Vec<(u32, String)>,
    /// How the fields of the bones are built.
    pub field_settings: FieldSettingsDocument,
    /// Model, elements, materials.
    pub physics: PhysicsRecord,
    /// Steps.
    pub steps: u32,
    /// Whether the solved mesh is kept.
    pub file: bool,
}

/// Tells the request of a scene from that of a case: only a scene has a ready mesh.
#[derive(Debug, Deserialize)]
pub(super) struct SolveKind {
    #[serde(default)]
    pub(super) ready: Option<serde::de::IgnoredAny>,
}

impl SolveRequest {
    /// Settings for the numerics, on the patient's `skull`.
    ///
    /// # Errors
    /// [`AttachmentRecord::rules`].
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
    /// A job's step.
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

/// Vertices of a surface that count.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct MaskRecord {
    /// Those in one of these.
    pub only: Vec<PartShape>,
    /// Those that are true here.
    pub vertices: Option<Vec<bool>>,
    /// Not those in one of these.
    pub except: Vec<PartShape>,
}

/// Registration before comparing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RegisterRecord {
    /// What it goes by.
    pub region: MaskRecord,
    /// What a job moves less than this is unmoved, mm.
    pub threshold_mm: f64,
}

/// Two surfaces to compare. The keys name what they were at the time of asking.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CompareRecord {
    /// What was predicted.
    pub prediction: SurfaceSource,
    /// What it is compared with.
    pub reference: SurfaceSource,
    /// Keys of both.
    pub keys: [String; 2],
    /// Prediction vertices that count.
    pub mask: MaskRecord,
    /// Parts that neither count nor are registered on.
    pub exclude: Vec<PartShape>,
    /// Whether the eyes do neither.
    #[serde(default)]
    pub exclude_eyes: bool,
    /// Registration.
    pub register: Option<RegisterRecord>,
}

impl From<&Part> for PartShape {
    fn from(part: &Part) -> Self {
        match part {
            Part::Box(bounds) => Self::Box(BoxDocument { min_mm: bounds.min.into(), max_mm: bounds.max.into() }),
            Part::Ball { centre, radius_mm } => Self::Ball((*centre).into(), *radius_mm),
        }
    }
}

impl From<&PartShape> for Part {
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
            only: record.only.iter().map(Part::from).collect(),
            vertices: record.vertices.clone(),
            except: record.except.iter().map(Part::from).collect(),
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
