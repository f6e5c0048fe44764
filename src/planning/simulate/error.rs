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
    /// A distance field could not be built.
    #[error(transparent)]
    Field(#[from] FieldError),
    /// The tissue could not be meshed.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// Cuts or paths cannot be used.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The solver ended with an error.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// An error map could not be computed.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// The caller cancelled the computation.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
