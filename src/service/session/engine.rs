use std::fmt::Debug;

use super::{Case, Cuts, Halt, Run, SceneRun, Solid, TissueRequest};
use prosopon_field::{FieldReport, CheckedDistance};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Point, TriMesh, Vector};
use prosopon_planning::evaluate::{ErrorMap, FaceRegion, Registration};
use prosopon_planning::plan::{Clearance, Cut, Osteotomy, PathReport, Plan, Proposal};
use prosopon_planning::simulate::{Frame, Milestone, Outcome};
use prosopon_planning::surface::{CtSettings, CtSurfaces};
use prosopon_tissue::mesh::MeshReport;

/// What a solve tells while it runs.
pub trait RunWatch {
    /// A stage begins: `field`, `cut`, `mesh` or `solve`.
    fn stage(&mut self, name: &'static str);
    /// The tissue mesh is there.
    fn mesh(&mut self, report: &MeshReport);
    /// Something to tell before the first step.
    fn warning(&mut self, text: String);
    /// A step is solved; `milestone` makes what a run can go on with after it, where it can.
    fn frame(&mut self, frame: Frame, milestone: &dyn Fn() -> Option<Milestone>);
}

/// What comes of a ready mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneSolved {
    /// The solved mesh as VTU, where asked for: displacement, stress, volume ratio.
    pub file: Option<Vec<u8>>,
    /// What a caller should know.
    pub warnings: Vec<String>,
}

/// The numerics as the service sees them; heavy intermediate results stay behind it.
///
/// Every method is a function of its arguments: results may be remembered, and are rebuilt the same when they are not.
/// All of them compute for long and must be called on the CPU pool.
pub trait Engine: Debug + Send + Sync {
    /// Skin, skull and air of a CT file.
    ///
    /// # Errors
    /// [`Halt`].
    fn surfaces(&self, ct: &[u8], settings: &CtSettings, control: &Control) -> Result<CtSurfaces, Halt>;

    /// Builds the fields of a case: reports of skin and bone, and warnings.
    ///
    /// # Errors
    /// [`Halt`].
    fn fields(&self, case: &Case, control: &Control) -> Result<(FieldReport, FieldReport, Vec<String>), Halt>;

    /// Distances with settled signs, gradients and closest points at `points`.
    ///
    /// # Errors
    /// [`Halt`].
    fn nearest(&self, case: &Case, solid: Solid, points: &[Point], control: &Control) -> Result<Vec<CheckedDistance>, Halt>;

    /// Signed distances (mm) and gradients at `points`.
    ///
    /// # Errors
    /// [`Halt`].
    fn distances(
        &self,
        case: &Case,
        solid: Solid,
        points: &[Point],
        control: &Control,
    ) -> Result<Vec<(f64, Vector)>, Halt>;

    /// Cuts the bone: the cuts of the templates, in their order, then the others. With how near they come to what is protected.
    ///
    /// # Errors
    /// [`Halt`].
    fn cut(&self, case: &Case, cuts: &Cuts, control: &Control) -> Result<(Osteotomy, Vec<Clearance>), Halt>;

    /// Landmarks proposed from the surfaces of skin and skull.
    fn propose(&self, skin: &TriMesh, skull: &TriMesh) -> Proposal;

    /// Follows the paths of a plan.
    ///
    /// # Errors
    /// [`Halt`].
    fn follow(&self, case: &Case, cuts: &[Cut], plan: &Plan, control: &Control) -> Result<Vec<PathReport>, Halt>;

    /// Meshes the tissue.
    ///
    /// # Errors
    /// [`Halt`].
    fn tissue(&self, case: &Case, request: &TissueRequest, control: &Control) -> Result<MeshReport, Halt>;

    /// Moves the bone and hands out steps.
    ///
    /// # Errors
    /// [`Halt`]; frames that were handed out stay valid.
    fn solve(&self, run: &Run, control: &Control, watch: &mut dyn RunWatch) -> Result<Outcome, Halt>;

    /// Moves a ready mesh by bone and hands out steps.
    ///
    /// # Errors
    /// [`Halt`]; frames that were handed out stay valid.
    fn solve_scene(&self, run: &SceneRun, control: &Control, watch: &mut dyn RunWatch) -> Result<SceneSolved, Halt>;

    /// The deformed volume as a VTU file: displacement, tissue, attachment, and volume ratio of every cell.
    ///
    /// # Errors
    /// [`Halt`].
    fn tissue_file(&self, run: &Run, nodes: &[Point], control: &Control) -> Result<Vec<u8>, Halt>;

    /// Parts of the face, and whether landmarks were used to find them.
    fn regions(&self, case: &Case) -> (Vec<FaceRegion>, bool);

    /// Signed error of `prediction` against `reference`.
    ///
    /// # Errors
    /// [`Halt`].
    fn error_map(
        &self,
        prediction: &TriMesh,
        reference: &TriMesh,
        mask: Option<&[bool]>,
        regions: &[FaceRegion],
        control: &Control,
    ) -> Result<ErrorMap, Halt>;

    /// Rigid motion that brings `source` onto `target` over the unaltered vertices.
    ///
    /// # Errors
    /// [`Halt`].
    fn register(
        &self,
        source: &TriMesh,
        target: &TriMesh,
        unaltered: Option<&[bool]>,
        control: &Control,
    ) -> Result<Registration, Halt>;
}
