use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::warning::Findings;
use prosopon_planning::simulate::{Frame, LeftOut, RegionMotion};
use prosopon_tissue::fem::PhaseTimes;

/// Force on a bone segment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReactionDocument {
    /// The segment; 0 is the fixed skull.
    pub segment: u32,
    /// Sum of the forces of tied nodes and contact, N, LPS.
    pub force_n: [f64; 3],
}

/// Wall time of the solver's phases, s; the phases do not overlap.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, ToSchema)]
pub struct StepPhasesDocument {
    /// Elements, elimination order and symbolic factorisation; in the first step only.
    pub setup_s: f64,
    /// Element tangents and their assembly.
    pub tangent_s: f64,
    /// Numeric factorisations.
    pub factor_s: f64,
    /// Triangular solves and conjugate gradients.
    pub solve_s: f64,
    /// Residuals.
    pub residual_s: f64,
    /// Contact search and the contact part of the matrix.
    pub contact_s: f64,
    /// Line searches with their energies and contacts.
    pub line_search_s: f64,
}

impl From<PhaseTimes> for StepPhasesDocument {
    fn from(p: PhaseTimes) -> Self {
        Self {
            setup_s: p.setup_s,
            tangent_s: p.tangent_s,
            factor_s: p.factor_s,
            solve_s: p.solve_s,
            residual_s: p.residual_s,
            contact_s: p.contact_s,
            line_search_s: p.line_search_s,
        }
    }
}

/// Cost and result of a step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StepDocument {
    /// Number, 1 to n.
    pub k: u32,
    /// Path parameter, 0 to 1.
    pub t: f64,
    /// Whether the convergence test was met, with every material elliptic and no element inverted.
    pub converged: bool,
    /// How the step ended: `converged`, `stabilised`, `outside_ellipticity` or `inside_out`.
    ///
    /// `stabilised`: stable materials replaced the requested ones. `outside_ellipticity`: forces balance, but a material has lost
    /// ellipticity. `inside_out`: forces balance, but the linear model inverts elements. Do not rely on the last two.
    #[serde(default = "plain_outcome")]
    pub outcome: String,
    /// Smallest det F over all quadrature points.
    pub min_det_f: f64,
    /// Largest penetration of a contact point, mm.
    pub max_penetration_mm: f64,
    /// Largest penetration of boundary nodes that no bone holds into bone beyond that at rest, mm.
    ///
    /// Contact does not act on free nodes, and at points of faces only: beside sharp edges nodes lie deeper than these.
    #[serde(default)]
    pub free_penetration_mm: f64,
    /// Largest change of distance between bone and tissue that glides on it, mm.
    #[serde(default)]
    pub gliding_gap_mm: f64,
    /// Number of gliding nodes that have come off bone.
    #[serde(default)]
    pub pulled_off_nodes: usize,
    /// Residual force over reaction force.
    pub relative_residual: f64,
    /// Estimate (not a bound) of the distance to the exact equilibrium, mm.
    ///
    /// From the residual and the last tangent, or the last iteration's movement of the skin. The last step converges to the
    /// solver's tolerance; intermediate steps are for display and end when the estimate is below 0.02 mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remaining_mm: Option<f64>,
    /// Number of Newton iterations, substeps included.
    pub newton_iterations: usize,
    /// Number of substeps.
    pub substeps: usize,
    /// Number of factorisations.
    ///
    /// The factorisation at rest counts in the first step of the first job with a mesh, materials, model and moving segments;
    /// later such jobs reuse it.
    pub factorisations: usize,
    /// Number of active contact points.
    pub active_contacts: usize,
    /// Number of unknowns.
    pub unknowns: usize,
    /// Forces on the bone.
    pub reactions: Vec<ReactionDocument>,
    /// Largest displacement of a skin vertex, mm.
    pub max_displacement_mm: f64,
    /// Time since the step before, s.
    pub wall_s: f64,
    /// Wall time of the solver's phases.
    #[serde(default)]
    pub phases: StepPhasesDocument,
    /// Warnings and notes.
    #[serde(flatten)]
    pub findings: Findings,
}

/// Outcome of records without one.
fn plain_outcome() -> String {
    "converged".to_owned()
}

impl StepDocument {
    /// The document of a frame that took `wall_s` seconds.
    #[must_use]
    pub fn new(frame: &Frame, wall_s: f64) -> Self {
        let r = &frame.report;
        let max_displacement = frame.displacement_mm.iter().copied().fold(0.0f32, f32::max);
        Self {
            k: u32::try_from(frame.k).unwrap_or(u32::MAX),
            t: frame.t,
            converged: r.outcome.converged(),
            outcome: r.outcome.name().to_owned(),
            min_det_f: r.min_det_f,
            max_penetration_mm: r.max_penetration_mm,
            free_penetration_mm: r.bone_penetration.map_or(0.0, |sunk| sunk.depth_mm),
            gliding_gap_mm: r.gliding_gap_mm,
            pulled_off_nodes: r.pulled_off,
            relative_residual: r.relative_residual,
            remaining_mm: r.remaining_mm.is_finite().then_some(r.remaining_mm),
            newton_iterations: r.newton_iterations,
            substeps: r.substeps,
            factorisations: r.factorisations,
            active_contacts: r.active_contacts,
            unknowns: r.unknowns,
            reactions: r.reactions_n.iter().map(|&(segment, force_n)| ReactionDocument { segment, force_n }).collect(),
            max_displacement_mm: f64::from(max_displacement),
            wall_s,
            phases: r.phases.into(),
            findings: r.warnings.iter().cloned().collect(),
        }
    }
}

/// Tissue that a solve left out because the plan hardly moves it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LeftOutDocument {
    /// Number of left-out nodes, which the plan was expected to move by less than `leave_out_below_mm`.
    pub nodes: usize,
    /// Number of nodes of the mesh.
    pub of_nodes: usize,
    /// Largest displacement of a free node next to a left-out one, mm.
    ///
    /// Left-out tissue would have moved by less.
    pub border_mm: f64,
}

impl From<LeftOut> for LeftOutDocument {
    fn from(l: LeftOut) -> Self {
        Self { nodes: l.nodes, of_nodes: l.of_nodes, border_mm: l.border_mm }
    }
}

/// Mean movement of a region of the face at the end of the path, mm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RegionMotionDocument {
    /// Forward (towards -y), mm.
    pub forward_mm: f64,
    /// Down (towards -z), mm.
    pub down_mm: f64,
    /// To the patient's left (+x), mm.
    pub left_mm: f64,
}

impl From<&RegionMotion> for RegionMotionDocument {
    fn from(r: &RegionMotion) -> Self {
        Self { forward_mm: r.forward_mm, down_mm: r.down_mm, left_mm: r.left_mm }
    }
}
