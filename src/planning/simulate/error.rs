use crate::evaluate::EvaluateError;
use crate::plan::PlanError;
use prosopon_field::FieldError;
use prosopon_geometry::control::Cancelled;
use prosopon_tissue::fem::SolveError;
use prosopon_tissue::mesh::MeshError;

/// Why a simulation could not be prepared or run.
#[derive(Debug, thiserror::Error)]
pub enum SimulateError {
    /// Skin and skull do not belong together.
    #[error("skin and skull do not fit together: {detail}")]
    Anatomy {
        /// What is wrong.
        detail: String,
    },
    /// A distance field.
    #[error(transparent)]
    Field(#[from] FieldError),
    /// The mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// Cuts or paths.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The solver.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// Error maps.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// Stopped by the caller.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
