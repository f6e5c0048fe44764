//! Why surfaces could not be compared.

use prosopon_geometry::control::Cancelled;

/// Why two surfaces could not be compared.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// There is no registration.
    #[error("registration: {0}")]
    Registration(#[from] RegistrationFault),
    /// Inputs do not fit together.
    #[error("{detail}")]
    Input {
        /// What does not fit.
        detail: String,
    },
    /// Stopped by the caller.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Why a registration was refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RegistrationFault {
    /// Little is left to go by.
    #[error(
        "the region to go by has {vertices} vertices and {area_mm2:.0} mm², at least {least_vertices} and {least_area_mm2:.0} mm² are needed"
    )]
    RegionTooSmall {
        /// Found.
        vertices: usize,
        /// Found, mm².
        area_mm2: f64,
        /// Allowed.
        least_vertices: usize,
        /// Allowed, mm².
        least_area_mm2: f64,
    },
    /// A plane, a ball, a cylinder.
    #[error(
        "the surfaces slide along each other: the shape of the region does not fix the motion (stiffness {stiffness:.1e}, at least {allowed:.0e} is needed)"
    )]
    Slides {
        /// Of the softest motion against the stiffest.
        stiffness: f64,
        /// Least.
        allowed: f64,
    },
    /// Nearly all closest points lie on the border of the reference.
    #[error("only {found} vertices have a partner inside the reference's border, at least {allowed} are needed")]
    NoPartners {
        /// Found.
        found: usize,
        /// Least.
        allowed: usize,
    },
    /// The iteration ran out.
    #[error("after {iterations} iterations points still move by {movement_mm:.3} mm{}", mirror(*mirrored))]
    NotConverged {
        /// Done.
        iterations: usize,
        /// In the last one, mm.
        movement_mm: f64,
        /// Whether the mirror image fits at least twice as well.
        mirrored: bool,
    },
    /// It stands still where the surfaces do not agree.
    #[error(
        "the surfaces do not match: the median distance stays at {median_mm:.1} mm (at most {allowed_mm} mm is allowed), {:.0} % of the region has a partner that counts{}",
        100.0 * overlap,
        mirror(*mirrored)
    )]
    NoMatch {
        /// Found, mm.
        median_mm: f64,
        /// Allowed, mm.
        allowed_mm: f64,
        /// Share of the region's area that has a partner.
        overlap: f64,
        /// Whether the mirror image fits at least twice as well.
        mirrored: bool,
    },
}

impl RegistrationFault {
    /// Its name for machines.
    #[must_use]
    pub fn reason(&self) -> &'static str {
        match self {
            Self::RegionTooSmall { .. } => "region_too_small",
            Self::Slides { .. } => "slides",
            Self::NoPartners { .. } => "no_partners",
            Self::NotConverged { .. } => "not_converged",
            Self::NoMatch { .. } => "no_match",
        }
    }
}

fn mirror(suspected: bool) -> &'static str {
    if suspected { "; the mirror image fits better: is one of them mirrored?" } else { "" }
}
