use serde::Deserialize;

use crate::Service;
use prosopon_contract::{Fault, PathDocument, PlanDocument, SolveRequest, SurfaceSource};
use prosopon_store::JobRecord;

/// Two predictions that are compared with each other.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Predictions {
    /// Names of the models of both.
    pub models: [String; 2],
    /// Whether both follow the same paths.
    pub same_plan: bool,
}

impl Predictions {
    /// Models and plans of two jobs; `None` when one of them is not a solve.
    #[must_use]
    pub fn of(one: &JobRecord, other: &JobRecord) -> Option<Self> {
        let (one, other) = (solve_of(one)?, solve_of(other)?);
        Some(Self { same_plan: one.1 == other.1, models: [one.0, other.0] })
    }

    /// Models and plans of two surfaces; `None` when one of them is not a step of a solve.
    ///
    /// # Errors
    /// As [`named_surface`](super::named_surface).
    pub async fn of_surfaces(service: &Service, sources: [SurfaceSource; 2]) -> Result<Option<Self>, Fault> {
        let [SurfaceSource::Step(one, _), SurfaceSource::Step(other, _)] = sources else { return Ok(None) };
        Ok(Self::of(&service.job(one).await?, &service.job(other).await?))
    }
}

/// Model and paths of a solve, on the session's own mesh or on an uploaded one.
fn solve_of(job: &JobRecord) -> Option<(String, Vec<PathDocument>)> {
    #[derive(Deserialize)]
    struct Solve {
        request: SolveRequest,
        plan: PlanDocument,
    }
    let solve: Solve = serde_json::from_str(&job.request).ok()?;
    Some((solve.request.solved_model().as_str().to_owned(), solve.plan.paths))
}
