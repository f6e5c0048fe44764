/// What one step needed and reached.
#[derive(Debug, Clone, PartialEq)]
pub struct StepReport {
    /// Whether the convergence test was met.
    pub converged: bool,
    /// Newton iterations, substeps included.
    pub newton_iterations: usize,
    /// Substeps that the step was cut into (1 when it was not).
    pub substeps: usize,
    /// Factorisations.
    pub factorisations: usize,
    /// Residual force relative to the reaction force.
    pub relative_residual: f64,
    /// Smallest det F over all quadrature points.
    pub min_det_f: f64,
    /// Largest penetration of a contact point, mm; 0 when nothing touches.
    pub max_penetration_mm: f64,
    /// Contact points that push.
    pub active_contacts: usize,
    /// Sum of the forces of tied nodes and contact, per body: segment and the force that the bone exerts on the tissue, N.
    pub reactions_n: Vec<(u32, [f64; 3])>,
    /// Number of unknowns.
    pub unknowns: usize,
    /// What was done to get there, and what a caller should know.
    pub warnings: Vec<String>,
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
