use super::element::ElementError;
use prosopon_geometry::control::Cancelled;

/// Why a step has no solution.
#[derive(Debug, thiserror::Error)]
pub enum SolveError {
    /// Elements are unusable at rest.
    #[error(transparent)]
    Element(#[from] ElementError),
    /// Mesh, bodies or settings do not fit together.
    #[error("the problem is not usable: {detail}")]
    Problem {
        /// What does not fit.
        detail: String,
    },
    /// Newton did not converge even with the shortest substep.
    #[error(
        "no equilibrium at {path_share:.4} of the path: residual {residual_n:.3e} N, allowed {tolerance_n:.3e} N, after {iterations} iterations"
    )]
    NotConverged {
        /// Share of the path, 0 to 1.
        path_share: f64,
        /// Iterations of the last substep.
        iterations: usize,
        /// Residual force, N.
        residual_n: f64,
        /// Allowed, N.
        tolerance_n: f64,
    },
    /// A step failed where a material had lost ellipticity, so that no stable equilibrium exists nearby.
    #[error(
        "{tissue} is not stable at {path_share:.4} of the path: {kind} {element} near ({x:.1}, {y:.1}, {z:.1}) mm is stretched to {stretch:.3} and its material has lost ellipticity"
    )]
    Unstable {
        /// Share of the path.
        path_share: f64,
        /// Name of the tissue.
        tissue: &'static str,
        /// Kind of element.
        kind: &'static str,
        /// Element index.
        element: usize,
        /// Largest principal stretch there.
        stretch: f64,
        /// Its rest position, mm.
        x: f64,
        /// Its rest position, mm.
        y: f64,
        /// Its rest position, mm.
        z: f64,
    },
    /// An element cannot follow the bone without turning inside out.
    #[error("{kind} {element} would turn inside out near ({x:.1}, {y:.1}, {z:.1}) mm at {path_share:.4} of the path")]
    Inverted {
        /// Share of the path.
        path_share: f64,
        /// Kind of element.
        kind: &'static str,
        /// Element index.
        element: usize,
        /// Its rest position, mm.
        x: f64,
        /// Its rest position, mm.
        y: f64,
        /// Its rest position, mm.
        z: f64,
    },
    /// Contact stayed deeper than allowed.
    #[error("penetration of {found_mm:.3} mm is left at {path_share:.4} of the path, allowed is {allowed_mm} mm")]
    Penetration {
        /// Share of the path.
        path_share: f64,
        /// Found, mm.
        found_mm: f64,
        /// Allowed, mm.
        allowed_mm: f64,
    },
    /// Tissue would come out on the other side of thin bone.
    #[error("tissue would pass through bone {segment} near ({x:.1}, {y:.1}, {z:.1}) mm at {path_share:.4} of the path")]
    PassedThrough {
        /// Share of the path.
        path_share: f64,
        /// The bone's segment.
        segment: u32,
        /// Where, mm.
        x: f64,
        /// Where, mm.
        y: f64,
        /// Where, mm.
        z: f64,
    },
    /// The equations do not fit into the memory that is allowed.
    #[error("{what} take about {needed_mb:.0} MB, {allowed_mb:.0} MB are allowed")]
    Memory {
        /// Elements, matrix or factor.
        what: &'static str,
        /// Estimate, MB.
        needed_mb: f64,
        /// Allowed, MB.
        allowed_mb: f64,
    },
    /// The factorisation failed.
    #[error("the stiffness matrix could not be factorised: {detail}")]
    Factorisation {
        /// Reason.
        detail: String,
    },
    /// A checkpoint is another problem's, or another build's.
    #[error("the checkpoint does not fit: {detail}")]
    Checkpoint {
        /// What does not.
        detail: &'static str,
    },
    /// Stopped by the caller.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
