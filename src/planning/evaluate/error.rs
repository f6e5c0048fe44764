//! Errors of comparison and registration.

use prosopon_geometry::control::Cancelled;

/// Reason why two surfaces could not be compared.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// The surfaces could not be registered.
    #[error("registration: {0}")]
    Registration(#[from] RegistrationFault),
    /// The inputs do not fit together.
    #[error("{detail}")]
    Input {
        /// Which inputs do not fit, and how.
        detail: String,
    },
    /// The caller cancelled the computation.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Reason why a registration was refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RegistrationFault {
    /// The region used for the registration has too few vertices or too little area.
    #[error(
        "the unaltered region has {vertices} vertices and {area_mm2:.0} mm², at least {min_vertices} and \
         {min_area_mm2:.0} mm² are needed: enlarge it"
    )]
    RegionTooSmall {
        /// Number of vertices found.
        vertices: usize,
        /// Area found, mm².
        area_mm2: f64,
        /// Smallest number of vertices allowed.
        min_vertices: usize,
        /// Smallest area allowed, mm².
        min_area_mm2: f64,
    },
    /// The region's shape, for example a plane, ball or cylinder, does not determine the motion.
    #[error(
        "the region is too flat or too round to determine the motion (stiffness {stiffness:.1e}, \
         at least {allowed:.0e} is needed): include more of the face"
    )]
    ShapeUndetermined {
        /// Stiffness of the softest rigid motion relative to the stiffest one, 0 to 1.
        stiffness: f64,
        /// Smallest stiffness allowed.
        allowed: f64,
    },
    /// Nearly all closest points lie on the border of the reference.
    #[error("only {found} vertices have a closest point inside the reference's border, at least {allowed} are needed")]
    TooFewPairs {
        /// Number of vertices with a closest point inside the border.
        found: usize,
        /// Smallest number allowed.
        allowed: usize,
    },
    /// The iteration did not converge.
    #[error("no convergence: points still move by {movement_mm:.3} mm after {iterations} iterations{}", mirror(*mirrored))]
    NotConverged {
        /// Number of iterations done.
        iterations: usize,
        /// Largest movement of a point in the last iteration, mm.
        movement_mm: f64,
        /// Whether the mirror image fits at least twice as well.
        mirrored: bool,
    },
    /// The iteration converged, but the surfaces do not match.
    #[error(
        "the surfaces do not match: the median distance stays at {median_mm:.1} mm (at most {allowed_mm} mm is allowed), \
         {:.0} % of the region's area matches{}",
        100.0 * overlap,
        mirror(*mirrored)
    )]
    NoMatch {
        /// Median distance found, mm.
        median_mm: f64,
        /// Largest median distance allowed, mm.
        allowed_mm: f64,
        /// Share of the region's area whose pairs are kept, 0 to 1.
        overlap: f64,
        /// Whether the mirror image fits at least twice as well.
        mirrored: bool,
    },
}

impl RegistrationFault {
    /// Machine-readable name of the reason.
    #[must_use]
    pub fn reason(&self) -> &'static str {
        match self {
            Self::RegionTooSmall { .. } => "region_too_small",
            Self::ShapeUndetermined { .. } => "slides",
            Self::TooFewPairs { .. } => "no_partners",
            Self::NotConverged { .. } => "not_converged",
            Self::NoMatch { .. } => "no_match",
        }
    }
}

fn mirror(suspected: bool) -> &'static str {
    if suspected { "; the mirror image fits better: check whether one surface is mirrored" } else { "" }
}
