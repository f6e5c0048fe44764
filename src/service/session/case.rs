use std::sync::Arc;

use prosopon_geometry::{TriMesh, VolumeMesh};
use prosopon_planning::plan::{Cut, Landmarks, Plan, Protected, TemplateCall};
use prosopon_planning::simulate::{Anatomy, FieldsSettings, Milestone, RunSettings, TissueSettings};
use prosopon_tissue::fem::SolveSettings;

/// A patient's surfaces with the settings of their fields.
#[derive(Debug, Clone)]
pub struct Case {
    /// Surfaces and landmarks.
    pub anatomy: Arc<Anatomy>,
    /// How the fields are built.
    pub fields: FieldsSettings,
    /// Key of everything that the fields are made from.
    pub key: String,
    /// x of the midline, mm, where known.
    pub midline_x_mm: Option<f64>,
}

/// Cuts asked for.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cuts {
    /// Templates. What they lack is proposed from the surfaces.
    pub templates: Vec<TemplateCall>,
    /// Further cuts.
    pub cuts: Vec<Cut>,
    /// What cuts should keep away from.
    pub protected: Vec<Protected>,
    /// Landmarks that segments are named by.
    pub landmarks: Landmarks,
}

/// A tissue mesh asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct TissueRequest {
    /// Settings of the mesh.
    pub settings: TissueSettings,
    /// Cuts whose segments choose the region; the front of the face when `None`.
    pub cuts: Option<Vec<Cut>>,
    /// Key of everything that the mesh is made from.
    pub key: String,
}

/// Everything that a solve needs.
#[derive(Debug, Clone)]
pub struct Run {
    /// The patient.
    pub case: Case,
    /// Cuts of the plan's osteotomy.
    pub cuts: Vec<Cut>,
    /// The tissue mesh.
    pub tissue: TissueRequest,
    /// Bone paths.
    pub plan: Plan,
    /// Model, steps, materials, attachment.
    pub settings: RunSettings,
    /// What was solved before, whose end this one begins at; the patient at rest when `None`.
    pub after: Option<Box<Earlier>>,
    /// The step that an earlier attempt came to.
    pub milestone: Option<Milestone>,
}

/// A plan that was solved before, with the same patient, cuts, tissue and settings.
#[derive(Debug, Clone, PartialEq)]
pub struct Earlier {
    /// Bone paths.
    pub plan: Plan,
    /// Its streamed steps.
    pub steps: usize,
    /// What it began at.
    pub after: Option<Box<Earlier>>,
}

/// Rigid bones of a scene.
#[derive(Debug, Clone)]
pub enum SceneBones {
    /// Surfaces by segment.
    Surfaces(Vec<(u32, TriMesh)>),
    /// Segments of the patient's bone.
    Cut {
        /// The patient.
        case: Box<Case>,
        /// The cuts that part the bone.
        cuts: Vec<Cut>,
    },
}

/// A ready tissue mesh moved by bone.
#[derive(Debug)]
pub struct SceneRun {
    /// The mesh as its file has it.
    pub volume: VolumeMesh,
    /// What sliding points touch.
    pub bones: SceneBones,
    /// How the fields of the bones are built.
    pub fields: FieldsSettings,
    /// Bone paths.
    pub plan: Plan,
    /// Model, elements, materials, tolerances.
    pub solver: SolveSettings,
    /// Streamed steps along the path.
    pub steps: usize,
    /// Whether the solved mesh is wanted as a file.
    pub file: bool,
    /// The step that an earlier attempt came to.
    pub milestone: Option<Milestone>,
}

/// A solid whose field can be asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Solid {
    /// Inside of the skin.
    Skin,
    /// Outer envelope of bone.
    Bone,
}
