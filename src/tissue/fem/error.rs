use super::element::ElementError;
use prosopon_geometry::control::Cancelled;

/// Reason why a step or its setup failed.
#[derive(Debug, thiserror::Error)]
pub enum SolveError {
    /// Elements are inverted at rest.
    #[error(transparent)]
    Element(#[from] ElementError),
    /// Mesh, bodies, boundary conditions or settings are inconsistent.
    #[error("the finite element problem is inconsistent: {detail}")]
    Problem {
        /// What is inconsistent.
        detail: String,
    },
    /// Newton did not converge even with the shortest substep.
    #[error(
        "no equilibrium at {path_share:.4} of the path after {iterations} iterations: {}",
        unbalanced(*residual_n, *tolerance_n)
    )]
    NotConverged {
        /// Path parameter, 0 to 1.
        path_share: f64,
        /// Newton iterations of the last substep.
        iterations: usize,
        /// Residual force, N.
        residual_n: f64,
        /// Allowed residual force, N.
        tolerance_n: f64,
    },
    /// A step failed after a material lost ellipticity, so that no stable equilibrium exists nearby.
    #[error(
        "{tissue} is not stable at {path_share:.4} of the path: {kind} {element} near ({x:.1}, {y:.1}, {z:.1}) mm is stretched \
         to {stretch:.3} and its material has lost ellipticity"
    )]
    Unstable {
        /// Path parameter, 0 to 1.
        path_share: f64,
        /// Name of the tissue.
        tissue: &'static str,
        /// Kind of element.
        kind: &'static str,
        /// Index of the element among those of its kind.
        element: usize,
        /// Largest principal stretch in the element.
        stretch: f64,
        /// Rest position of the element, LPS x, mm.
        x: f64,
        /// LPS y, mm.
        y: f64,
        /// LPS z, mm.
        z: f64,
    },
    /// An element would be inverted by the motion of the bone.
    #[error("{kind} {element} would turn inside out near ({x:.1}, {y:.1}, {z:.1}) mm at {path_share:.4} of the path")]
    Inverted {
        /// Path parameter, 0 to 1.
        path_share: f64,
        /// Kind of element.
        kind: &'static str,
        /// Index of the element among those of its kind.
        element: usize,
        /// Rest position of the element, LPS x, mm.
        x: f64,
        /// LPS y, mm.
        y: f64,
        /// LPS z, mm.
        z: f64,
    },
    /// Penetration stayed above its tolerance.
    #[error("penetration of {found_mm:.3} mm remains at {path_share:.4} of the path, allowed is {allowed_mm} mm")]
    Penetration {
        /// Path parameter, 0 to 1.
        path_share: f64,
        /// Largest penetration found, mm.
        found_mm: f64,
        /// Tolerance, mm.
        allowed_mm: f64,
    },
    /// Tissue would pass to the other side of thin bone.
    #[error("tissue would pass through bone {segment} near ({x:.1}, {y:.1}, {z:.1}) mm at {path_share:.4} of the path")]
    PassedThrough {
        /// Path parameter, 0 to 1.
        path_share: f64,
        /// Segment of the bone.
        segment: u32,
        /// Position of the tissue, LPS x, mm.
        x: f64,
        /// LPS y, mm.
        y: f64,
        /// LPS z, mm.
        z: f64,
    },
    /// The equations need more memory than is allowed.
    #[error("{what} need about {needed_mb:.0} MB, {allowed_mb:.0} MB are allowed")]
    Memory {
        /// The part that needs it: elements, matrix or factor.
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
    /// The checkpoint belongs to another problem or another build.
    #[error("the checkpoint does not match this problem: {detail}")]
    Checkpoint {
        /// What does not match.
        detail: &'static str,
    },
    /// Cancelled by the caller.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Which of the two tests of an equilibrium is not met: that of the forces, or that of the points.
fn unbalanced(residual_n: f64, tolerance_n: f64) -> String {
    if residual_n > tolerance_n {
        format!("residual {residual_n:.3e} N, allowed {tolerance_n:.3e} N")
    } else {
        format!("forces balance (residual {residual_n:.3e} N), but points still move from one iteration to the next")
    }
}
