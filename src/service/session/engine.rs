use std::fmt::Debug;

use super::{Case, Kept, Run, SceneRun, TissueRequest};
use prosopon_contract::{Cuts, Halt, Solid};
use prosopon_field::{CheckedDistance, FieldReport};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, TriMesh, Vector, Warning};
use prosopon_planning::evaluate::{Clinical, ErrorMap, FaceRegion, GivenLandmarks, HeadFrame, Registration};
use prosopon_planning::plan::{Clearance, Cut, Osteotomy, PathReport, Plan, Proposal};
use prosopon_planning::simulate::{Frame, Outcome, PathCheckpoint};
use prosopon_planning::surface::{CtSettings, CtSurfaces};
use prosopon_tissue::mesh::MeshReport;

/// Receiver of the progress of a solve.
pub trait RunWatch {
    /// A stage begins: `field`, `cut`, `mesh` or `solve`.
    fn stage(&mut self, name: &'static str);
    /// The tissue mesh is built.
    fn mesh(&mut self, report: &MeshReport);
    /// A warning from before the first step.
    fn warning(&mut self, warning: Warning);
    /// A step is solved; `checkpoint` makes the checkpoint after it, if there can be one.
    fn frame(&mut self, frame: Frame, checkpoint: &dyn Fn() -> Option<PathCheckpoint>);
}

/// A surface that is checked against the skin.
#[derive(Debug, Clone, Copy)]
pub struct OtherSurface<'a> {
    /// Name of the part, for messages.
    pub name: &'a str,
    /// Whether it is bone, which lies within the skin; otherwise it is a skin of the same head.
    pub is_bone: bool,
    /// The surface.
    pub mesh: &'a TriMesh,
}

/// Result of a solve with an uploaded tissue mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneSolved {
    /// The solved mesh as VTU with displacement, stress and volume ratio; `None` unless requested.
    pub file: Option<Vec<u8>>,
    /// Warnings.
    pub warnings: Vec<Warning>,
}

/// The numerics behind the service.
///
/// Every method but [`Engine::has`] and [`Engine::bytes_of`] is a function of its arguments: an implementation may cache results and rebuilds identical ones. All methods
/// compute for long and must run on the CPU pool.
pub trait Engine: Debug + Send + Sync {
    /// Extracts skin, skull, air and soft tissue from a CT file.
    ///
    /// # Errors
    /// [`Halt`].
    fn surfaces(&self, ct: &[u8], settings: &CtSettings, control: &Control) -> Result<CtSurfaces, Halt>;

    /// Builds the fields of a case; returns the reports of skin and bone, and warnings.
    ///
    /// # Errors
    /// [`Halt`].
    fn fields(&self, case: &Case, control: &Control) -> Result<(FieldReport, FieldReport, Vec<Warning>), Halt>;

    /// Distances with reliable signs, gradients and closest points at `points` (LPS mm).
    ///
    /// # Errors
    /// [`Halt`].
    fn nearest(
        &self,
        case: &Case,
        solid: Solid,
        points: &[Point],
        control: &Control,
    ) -> Result<Vec<CheckedDistance>, Halt>;

    /// Signed distances (mm) and gradients at `points` (LPS mm).
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

    /// Cuts the bone with the cuts of the templates, in their order, then with the others.
    ///
    /// Also returns the distance of each cut to each protected point or curve.
    ///
    /// # Errors
    /// [`Halt`].
    fn cut(&self, case: &Case, cuts: &Cuts, control: &Control) -> Result<(Osteotomy, Vec<Clearance>), Halt>;

    /// The cuts that [`Self::cut`] would make, and warnings about where they are.
    ///
    /// # Errors
    /// [`Halt`].
    fn place(&self, case: &Case, cuts: &Cuts, control: &Control) -> Result<(Vec<Cut>, Vec<Warning>), Halt>;

    /// Warnings about landmarks off their surfaces, or not arranged as in a head.
    ///
    /// # Errors
    /// [`Halt`].
    fn check_landmarks(
        &self,
        _landmarks: &GivenLandmarks<'_>,
        _skin: Option<&TriMesh>,
        _skull: Option<&TriMesh>,
    ) -> Result<Vec<Warning>, Halt> {
        Ok(Vec::new())
    }

    /// The warning of bone, or of another skin, that is not in the frame of `skin`.
    ///
    /// # Errors
    /// [`Halt`].
    fn check_surfaces(&self, _skin: &TriMesh, _other: &OtherSurface<'_>) -> Result<Option<Warning>, Halt> {
        Ok(None)
    }

    /// The frame of the patient's head: the one that the case names, else an estimate from the surfaces.
    ///
    /// # Errors
    /// [`Halt`].
    fn frame(&self, _case: &Case, _control: &Control) -> Result<HeadFrame, Halt> {
        Ok(HeadFrame::of_scanner())
    }

    /// Proposes landmarks from the surfaces of skin and skull.
    ///
    /// # Errors
    /// [`Halt`].
    fn propose(&self, case: &Case, control: &Control) -> Result<Proposal, Halt>;

    /// Displacements along the paths of a plan; returns a report for each path, without overlaps and gaps.
    ///
    /// # Errors
    /// [`Halt`].
    fn outline(&self, case: &Case, cuts: &[Cut], plan: &Plan, control: &Control) -> Result<Vec<PathReport>, Halt>;

    /// Measures overlaps and gaps along the paths of a plan; returns a report for each path.
    ///
    /// # Errors
    /// [`Halt`].
    fn follow(&self, case: &Case, cuts: &[Cut], plan: &Plan, control: &Control) -> Result<Vec<PathReport>, Halt>;

    /// Builds the tissue mesh.
    ///
    /// # Errors
    /// [`Halt`].
    fn tissue(&self, case: &Case, request: &TissueRequest, control: &Control) -> Result<MeshReport, Halt>;

    /// Whether the result is in memory, so that nothing need be built.
    fn has(&self, kept: Kept, key: &str) -> bool;

    /// The result as bytes for [`Self::recall`]; `None` when it is not in memory, or is of a kind that is not kept.
    fn bytes_of(&self, kept: Kept, key: &str) -> Option<Vec<u8>>;

    /// Takes a result that [`Self::bytes_of`] the same program gave; false for bytes of another one.
    fn recall(&self, kept: Kept, key: &str, bytes: &[u8]) -> bool;

    /// The skin at rest that a solve moves: that of the case, or where lips part, with its triangles cut along the mouth.
    ///
    /// # Errors
    /// [`Halt`].
    fn skin(&self, run: &Run, _control: &Control) -> Result<TriMesh, Halt> {
        Ok(run.case.anatomy.skin.clone())
    }

    /// Solves along the plan; reports each step to `watch`.
    ///
    /// # Errors
    /// [`Halt`]; steps that were reported stay valid.
    fn solve(&self, run: &Run, control: &Control, watch: &mut dyn RunWatch) -> Result<Outcome, Halt>;

    /// Distance between `moved`, the skin at the end of `run`, and that of the same run on another tissue mesh, mm.
    ///
    /// It is the 95th percentile over the part of the face that moves; `None` when none does.
    ///
    /// # Errors
    /// [`Halt`].
    fn distance_to_mesh(
        &self,
        run: &Run,
        moved: &TriMesh,
        other: &TissueRequest,
        control: &Control,
    ) -> Result<Option<f64>, Halt>;

    /// Solves an uploaded tissue mesh along the plan; reports each step to `watch`.
    ///
    /// # Errors
    /// [`Halt`]; steps that were reported stay valid.
    fn solve_scene(&self, run: &SceneRun, control: &Control, watch: &mut dyn RunWatch) -> Result<SceneSolved, Halt>;

    /// The deformed volume as a VTU file; `nodes` are the deformed positions, LPS mm.
    ///
    /// With displacement and attachment of every node, and tissue and volume ratio of every cell.
    ///
    /// # Errors
    /// [`Halt`].
    fn tissue_file(&self, run: &Run, outcome: &Outcome, control: &Control) -> Result<Vec<u8>, Halt>;

    /// The prediction in a surgeon's terms, in the frame of the head; `moved` is the skin at the end of the path, in LPS.
    ///
    /// # Errors
    /// [`Halt`].
    fn clinical(&self, run: &Run, moved: &TriMesh, control: &Control) -> Result<Clinical, Halt>;

    /// Displacement of each vertex of `skin`, at rest, at 0.7 of the nearest bone, mm.
    ///
    /// `cuts` part the bone of the case into segments, of which `motions` moves some from rest.
    ///
    /// # Errors
    /// [`Halt`].
    fn nearest_bone(
        &self,
        case: &Case,
        cuts: &[Cut],
        motions: &[(u32, Motion)],
        skin: &TriMesh,
        control: &Control,
    ) -> Result<Option<Vec<Vector>>, Halt>;

    /// Regions of the face, and whether landmarks placed them.
    ///
    /// # Errors
    /// [`Halt`].
    fn regions(&self, case: &Case, control: &Control) -> Result<(Vec<FaceRegion>, bool), Halt>;

    /// Signed error of `prediction` against `reference`, mm, over the vertices of the mask.
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

    /// Rigid motion that maps `source` onto `target` over the unaltered vertices.
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
