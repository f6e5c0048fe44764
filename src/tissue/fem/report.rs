use super::tuning::{DEEP_FREE_TISSUE_MM, REPORTED_DEPTH_MM};
use std::fmt;

use prosopon_geometry::{Motion, Point, Vector, Warning};

/// Loss of strong ellipticity: equilibrium is not well posed there and depends on the mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LostEllipticity {
    /// Number of elements in which it is lost.
    pub elements: usize,
    /// Tissue of the most stretched of these elements.
    pub tissue: &'static str,
    /// Kind of that element.
    pub kind: &'static str,
    /// Index of that element among those of its kind.
    pub element: usize,
    /// Largest principal stretch in it.
    pub stretch: f64,
    /// Position of that element at rest, LPS mm.
    pub place: Point,
}

impl fmt::Display for LostEllipticity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { elements, tissue, kind, element, stretch, place } = self;
        let [x, y, z] = [place.x, place.y, place.z];
        write!(
            f,
            "the material of {elements} elements has lost ellipticity, the most stretched is {kind} {element} ({tissue}) near \
             ({x:.1}, {y:.1}, {z:.1}) mm at a stretch of {stretch:.3}"
        )
    }
}

/// Outcome of a step that met the convergence test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StepOutcome {
    /// Equilibrium, with every material elliptic.
    Converged,
    /// Equilibrium with stable materials, which replaced those requested.
    ///
    /// See [`UnstableMaterial::Stabilise`](super::UnstableMaterial::Stabilise).
    Stabilised,
    /// Forces balance, but a material has lost ellipticity: the result is unreliable.
    OutsideEllipticity(LostEllipticity),
    /// Forces balance, but the small-strain model has inverted elements: the result is unreliable.
    InsideOut {
        /// Number of inverted elements.
        elements: usize,
        /// Smallest det F.
        min_det_f: f64,
    },
}

impl StepOutcome {
    /// Whether the equilibrium is reliable.
    #[must_use]
    pub fn converged(&self) -> bool {
        self.fault().is_none()
    }

    /// Reason why the result is unreliable; `None` when it is reliable.
    #[must_use]
    pub fn fault(&self) -> Option<String> {
        match self {
            Self::Converged | Self::Stabilised => None,
            Self::OutsideEllipticity(lost) => Some(lost.to_string()),
            Self::InsideOut { elements, min_det_f } => Some(format!(
                "the linear model turns {elements} elements inside out (det F down to {min_det_f:.3}): strains are too large \
                 for it"
            )),
        }
    }

    /// Warning about an unreliable result; `None` when it is reliable.
    #[must_use]
    pub fn warning(&self) -> Option<Warning> {
        let code = match self {
            Self::Converged | Self::Stabilised => return None,
            Self::OutsideEllipticity(_) => "lost-ellipticity",
            Self::InsideOut { .. } => "inside-out-elements",
        };
        let action = match self {
            Self::InsideOut { .. } => "Use a nonlinear model.",
            Self::OutsideEllipticity(_) | Self::Converged | Self::Stabilised => "Use stable materials.",
        };
        self.fault().map(|fault| Warning::unreliable(code, fault).act(action))
    }

    /// Name in documents: `converged`, `stabilised`, `outside_ellipticity`, `inside_out`.
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

/// Boundary points that no bone holds, free or beside points of contact, and that lie deeper in bone than at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BonePenetration {
    /// Depth of the deepest point, relative to rest, mm.
    pub depth_mm: f64,
    /// Segment that this point lies in.
    pub segment: u32,
    /// Current position of this point, LPS mm.
    pub place: Point,
    /// Number of such points, vertices and barycentres.
    pub points: usize,
}

impl BonePenetration {
    /// Warning about this depth; `None` when it is small.
    #[must_use]
    pub fn warning(&self) -> Option<Warning> {
        let Self { depth_mm, segment, place, points } = self;
        (*depth_mm > REPORTED_DEPTH_MM).then(|| {
            let message = format!(
                "free tissue lies inside bone at {points} points, up to {depth_mm:.1} mm in bone {segment} near ({:.1}, {:.1}, \
                 {:.1}) mm: contact acts on sliding points only",
                place.x, place.y, place.z
            );
            if *depth_mm > DEEP_FREE_TISSUE_MM {
                Warning::check("free-tissue-in-bone", message).act("Let the tissue there slide on the bone.")
            } else {
                Warning::info("free-tissue-in-bone", message)
            }
        })
    }
}

impl StepReport {
    /// The report with forces and places in another frame, into which `motion` maps.
    #[must_use]
    pub fn moved(&self, motion: &Motion) -> Self {
        let outcome = match self.outcome {
            StepOutcome::OutsideEllipticity(lost) => {
                StepOutcome::OutsideEllipticity(LostEllipticity { place: motion * lost.place, ..lost })
            }
            StepOutcome::Converged | StepOutcome::Stabilised | StepOutcome::InsideOut { .. } => self.outcome,
        };
        let reaction = |(segment, force): &(u32, [f64; 3])| (*segment, (motion * Vector::from(*force)).into());
        Self {
            outcome,
            bone_penetration: self.bone_penetration.map(|p| BonePenetration { place: motion * p.place, ..p }),
            reactions_n: self.reactions_n.iter().map(reaction).collect(),
            warnings: self.warnings.iter().map(|w| w.clone().moved(motion)).collect(),
            ..self.clone()
        }
    }

    /// Largest depth in bone, relative to rest, of any boundary point that no bone holds, mm.
    #[must_use]
    pub fn deepest_mm(&self) -> f64 {
        self.max_penetration_mm.max(self.bone_penetration.map_or(0.0, |bone_penetration| bone_penetration.depth_mm))
    }
}

/// Cost and result of one step.
#[derive(Debug, Clone, PartialEq)]
pub struct StepReport {
    /// Outcome.
    pub outcome: StepOutcome,
    /// Newton iterations, substeps included.
    pub newton_iterations: usize,
    /// Number of substeps (1 when the step was not divided).
    pub substeps: usize,
    /// Number of factorisations.
    pub factorisations: usize,
    /// Residual force relative to the reaction force.
    pub relative_residual: f64,
    /// Estimate (no bound) of the remaining displacement, mm.
    ///
    /// It is the displacement that the last tangent predicts from the residual, or the last iteration's movement of the skin for
    /// a step solved for display. Points that slide slowly over an edge of bone may be several times farther off.
    pub remaining_mm: f64,
    /// Smallest det F over all quadrature points.
    pub min_det_f: f64,
    /// Largest penetration of a contact point, mm; 0 without active contacts.
    pub max_penetration_mm: f64,
    /// Largest change of distance between bone and a node that glides on it, mm.
    pub gliding_gap_mm: f64,
    /// Number of gliding nodes that have come off bone.
    pub pulled_off: usize,
    /// Boundary points without contact that have penetrated bone; `None` when there are none.
    pub bone_penetration: Option<BonePenetration>,
    /// Number of active contact points.
    pub active_contacts: usize,
    /// For each segment, the total force of its tied nodes and its contact on the tissue, N.
    pub reactions_n: Vec<(u32, [f64; 3])>,
    /// Number of scalar unknowns.
    pub unknowns: usize,
    /// Wall time by phase; zeros without a clock.
    pub phases: PhaseTimes,
    /// Warnings for the caller.
    pub warnings: Vec<Warning>,
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
    /// Search for contact points and their part of the matrix.
    pub contact_s: f64,
    /// Line searches, with their energies and contacts.
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

/// State of a cell of the mesh, averaged over its volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellState {
    /// Cauchy stress, MPa: xx, yy, zz, xy, yz, xz.
    pub stress_mpa: [f64; 6],
    /// det F: current volume over volume at rest.
    pub volume_ratio: f64,
}

/// One Newton iteration.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct IterationRecord {
    /// Path parameter at the end of the substep.
    pub t: f64,
    /// Residual force before the iteration, N.
    pub residual_n: f64,
    /// Reaction force that the residual is compared with, N.
    pub reaction_n: f64,
    /// Largest displacement of a node in this iteration, mm.
    pub displacement_mm: f64,
    /// Share of the Newton step that was taken.
    pub step: f64,
    /// Whether the tangent was projected to be positive semi-definite.
    pub projected: bool,
    /// Whether the exact tangent was not positive definite.
    pub unstable: bool,
    /// Whether the matrix was factorised; otherwise an older factor preconditioned conjugate gradients.
    pub factorised: bool,
    /// Conjugate gradient iterations.
    pub cg_iterations: usize,
    /// Number of active contact points.
    pub active_contacts: usize,
}
