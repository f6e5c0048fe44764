use std::fmt;

use prosopon_geometry::Point;

/// Where a material has lost strong ellipticity: an equilibrium there is not well posed, and depends on the mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LostEllipticity {
    /// Elements in which it is lost.
    pub elements: usize,
    /// Tissue of the most stretched one of them.
    pub tissue: &'static str,
    /// Its kind.
    pub kind: &'static str,
    /// Its index.
    pub element: usize,
    /// Largest principal stretch in it.
    pub stretch: f64,
    /// Its place at rest, mm.
    pub place: Point,
}

impl fmt::Display for LostEllipticity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { elements, tissue, kind, element, stretch, place } = self;
        let [x, y, z] = [place.x, place.y, place.z];
        write!(
            f,
            "the material of {elements} elements has lost ellipticity, the worst is {kind} {element} ({tissue}) near ({x:.1}, {y:.1}, {z:.1}) mm at a stretch of {stretch:.3}"
        )
    }
}

/// How a step ended that met the convergence test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StepOutcome {
    /// In equilibrium, every material elliptic.
    Converged,
    /// In equilibrium of stable materials, which took the place of those asked for, as told by
    /// [`UnstableMaterial::Stabilise`](super::UnstableMaterial::Stabilise).
    Stabilised,
    /// Forces balance, but a material has lost ellipticity: no answer to rely on.
    OutsideEllipticity(LostEllipticity),
    /// Forces balance, but elements lie inside out, which small strain does not know of: no answer to rely on.
    InsideOut {
        /// How many.
        elements: usize,
        /// Smallest det F.
        min_det_f: f64,
    },
}

impl StepOutcome {
    /// Whether the equilibrium is one to rely on.
    #[must_use]
    pub fn converged(&self) -> bool {
        self.fault().is_none()
    }

    /// Why it is not to be relied on, if it is not.
    #[must_use]
    pub fn fault(&self) -> Option<String> {
        match self {
            Self::Converged | Self::Stabilised => None,
            Self::OutsideEllipticity(lost) => Some(lost.to_string()),
            Self::InsideOut { elements, min_det_f } => Some(format!(
                "the linear model turns {elements} elements inside out (det F down to {min_det_f:.3}): strains are too large for it"
            )),
        }
    }

    /// Its name on the wire: `converged`, `stabilised`, `outside_ellipticity`, `inside_out`.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::Stabilised => "stabilised",
            Self::OutsideEllipticity(_) => "outside_ellipticity",
            Self::InsideOut { .. } => "inside_out",
        }
    }
}

/// Free points of the boundary that lie deeper in bone than at rest: contact acts on sliding points alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sunk {
    /// By how much the deepest one does, mm.
    pub depth_mm: f64,
    /// The bone that it lies in.
    pub segment: u32,
    /// Where it is now, mm.
    pub place: Point,
    /// How many do, vertices and barycentres.
    pub points: usize,
}

impl Sunk {
    /// Depths below this are not worth a word, mm: about what an edge of a mesh leaves open.
    const TOLD_MM: f64 = 0.5;

    /// What to tell of it, where it is deep.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        let Self { depth_mm, segment, place, points } = self;
        (*depth_mm > Self::TOLD_MM).then(|| {
            format!(
                "tissue that is free lies inside bone at {points} points, up to {depth_mm:.1} mm in bone {segment} near ({:.1}, {:.1}, {:.1}) mm: contact \
                 acts on sliding points alone",
                place.x, place.y, place.z
            )
        })
    }
}

impl StepReport {
    /// Largest depth in bone, more than at rest, of any point of the boundary that no bone holds, mm.
    #[must_use]
    pub fn deepest_mm(&self) -> f64 {
        self.max_penetration_mm.max(self.sunk.map_or(0.0, |sunk| sunk.depth_mm))
    }
}

/// What one step needed and reached.
#[derive(Debug, Clone, PartialEq)]
pub struct StepReport {
    /// How it ended.
    pub outcome: StepOutcome,
    /// Newton iterations, substeps included.
    pub newton_iterations: usize,
    /// Substeps that the step was cut into (1 when it was not).
    pub substeps: usize,
    /// Factorisations.
    pub factorisations: usize,
    /// Residual force relative to the reaction force.
    pub relative_residual: f64,
    /// Estimate, no bound, of the displacement that is left, mm: what the residual could still cause as the last tangent sees it, or
    /// for a step converged for the eye the last iteration's movement of the skin. Points that creep over an edge of the bone may
    /// be several times farther off.
    pub remaining_mm: f64,
    /// Smallest det F over all quadrature points.
    pub min_det_f: f64,
    /// Largest penetration of a contact point, mm; 0 when nothing touches.
    pub max_penetration_mm: f64,
    /// Free points of the boundary that have sunk into bone; `None` when there are none.
    pub sunk: Option<Sunk>,
    /// Contact points that push.
    pub active_contacts: usize,
    /// Sum of the forces of tied nodes and contact, per body: segment and the force that the bone exerts on the tissue, N.
    pub reactions_n: Vec<(u32, [f64; 3])>,
    /// Number of unknowns.
    pub unknowns: usize,
    /// Where the time went; zeros without a clock.
    pub phases: PhaseTimes,
    /// What was done to get there, and what a caller should know.
    pub warnings: Vec<String>,
}

/// Wall time by phase, s. No phase contains another.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PhaseTimes {
    /// Elements, unknowns, elimination order, pattern and symbolic factorisation; only in the first step.
    pub setup_s: f64,
    /// Tangents of the elements and their assembly.
    pub tangent_s: f64,
    /// Numeric factorisations.
    pub factor_s: f64,
    /// Triangular solves and conjugate gradients.
    pub solve_s: f64,
    /// Residuals.
    pub residual_s: f64,
    /// Search of contact points and their part of the matrix.
    pub contact_s: f64,
    /// Line searches, their energies and contacts.
    pub line_search_s: f64,
}

impl PhaseTimes {
    /// Sum of all phases, s.
    #[must_use]
    pub fn total_s(&self) -> f64 {
        self.setup_s
            + self.tangent_s
            + self.factor_s
            + self.solve_s
            + self.residual_s
            + self.contact_s
            + self.line_search_s
    }
}

impl std::ops::AddAssign for PhaseTimes {
    fn add_assign(&mut self, other: Self) {
        self.setup_s += other.setup_s;
        self.tangent_s += other.tangent_s;
        self.factor_s += other.factor_s;
        self.solve_s += other.solve_s;
        self.residual_s += other.residual_s;
        self.contact_s += other.contact_s;
        self.line_search_s += other.line_search_s;
    }
}

/// State of a cell of the mesh, a mean over its volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellState {
    /// Cauchy stress xx, yy, zz, xy, yz, xz, MPa.
    pub stress_mpa: [f64; 6],
    /// det F: present volume over volume at rest.
    pub volume_ratio: f64,
}

/// One Newton iteration.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct IterationRecord {
    /// Path parameter that was aimed at.
    pub t: f64,
    /// Residual force before the iteration, N.
    pub residual_n: f64,
    /// Reaction force that the residual is compared with, N.
    pub reaction_n: f64,
    /// Largest displacement of a node by this iteration, mm.
    pub displacement_mm: f64,
    /// Share of the Newton step that was taken.
    pub step: f64,
    /// Whether the tangent was projected to be positive semi-definite.
    pub projected: bool,
    /// Whether the exact tangent was not positive definite.
    pub unstable: bool,
    /// Whether the matrix was factorised anew; otherwise an older factor preconditioned conjugate gradients.
    pub factorised: bool,
    /// Conjugate gradient iterations.
    pub cg_iterations: usize,
    /// Contact points that push.
    pub active_contacts: usize,
}
