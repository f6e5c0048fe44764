use std::sync::Arc;

use prosopon_geometry::{Motion, TriMesh, VolumeMesh};
use prosopon_planning::evaluate::GivenLandmarks;
use prosopon_planning::plan::{Cut, Plan};
use prosopon_planning::simulate::{Anatomy, FieldsSettings, PathCheckpoint, RunSettings, TissueSettings};
use prosopon_tissue::fem::SolveSettings;

/// A patient case: surfaces and landmarks, with the settings of their fields.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// Surfaces and landmarks.
    pub anatomy: Arc<Anatomy>,
    /// Settings of the distance fields.
    pub fields: FieldsSettings,
    /// Key of everything that the fields are built from.
    pub key: String,
    /// x of the midline, mm; `None` when unknown.
    pub midline_x_mm: Option<f64>,
    /// z of the occlusal plane, mm; `None` when unknown.
    pub occlusal_z_mm: Option<f64>,
    /// Names of the landmarks that nobody has confirmed.
    pub unconfirmed: Vec<String>,
    /// Frame of the head that someone set: maps LPS into it, mm. `None`: it is estimated from the surfaces.
    pub frame: Option<Motion>,
}

impl Case {
    /// The landmarks with what their check needs.
    #[must_use]
    pub fn given_landmarks(&self) -> GivenLandmarks<'_> {
        let points = &self.anatomy.landmarks;
        GivenLandmarks { points, unconfirmed: &self.unconfirmed, midline_x_mm: self.midline_x_mm }
    }
}

/// A tissue mesh of a request.
#[derive(Debug, Clone, PartialEq)]
pub struct TissueRequest {
    /// Settings of the mesh.
    pub settings: TissueSettings,
    /// Cuts whose segments determine the meshed region; the front of the face when `None`.
    pub cuts: Option<Vec<Cut>>,
    /// Key of everything that the mesh is built from.
    pub key: String,
}

/// Inputs of a solve.
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
    /// Earlier solve from whose end state this one starts; rest when `None`.
    pub after: Option<Box<Earlier>>,
    /// Checkpoint of an earlier attempt, from which the solve continues.
    pub checkpoint: Option<PathCheckpoint>,
}

/// An earlier solve with the same patient, cuts, tissue and settings.
#[derive(Debug, Clone, PartialEq)]
pub struct Earlier {
    /// Bone paths.
    pub plan: Plan,
    /// Number of its steps.
    pub steps: usize,
    /// Solve from whose end state it started; rest when `None`.
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
        /// The cuts that separate the segments.
        cuts: Vec<Cut>,
    },
}

/// Inputs of a solve with an uploaded tissue mesh.
#[derive(Debug)]
pub struct SceneRun {
    /// The mesh of the file.
    pub volume: VolumeMesh,
    /// Bones for the contact of sliding nodes.
    pub bones: SceneBones,
    /// Settings of the distance fields of the bones.
    pub fields: FieldsSettings,
    /// Bone paths.
    pub plan: Plan,
    /// Model, elements, materials, tolerances.
    pub solver: SolveSettings,
    /// Number of steps along the path.
    pub steps: usize,
    /// Whether to return the solved mesh as a file.
    pub file: bool,
    /// Checkpoint of an earlier attempt, from which the solve continues.
    pub checkpoint: Option<PathCheckpoint>,
}
