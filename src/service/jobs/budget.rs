//! What a budget of `auto` leaves to choose.

use crate::requests::{Given, MeshChoice};
use prosopon_contract::{PlanDocument, SolveRequest};
use prosopon_planning::simulate::budget::{COARSER, Demand, KnownMesh};

/// What is known of a solve before its setting is chosen; `known` is a mesh of the same region.
#[must_use]
pub fn demand_of(
    request: &SolveRequest,
    mesh: &MeshChoice,
    plan: &PlanDocument,
    given: Given,
    known: Option<KnownMesh>,
) -> Demand {
    let settings = &mesh.settings;
    Demand {
        displacement_mm: plan.reports.iter().map(|r| r.max_displacement_mm).fold(0.0, f64::max),
        steps: request.steps(),
        mesh: known,
        // The coarser mesh of the estimate must be deep enough too.
        max_edge_mm: 0.5 * (settings.depth_mm - settings.skin_thickness_mm) / COARSER,
        edge_mm: given.mesh.then_some(settings.edge_mm),
        locking: request.locking.filter(|_| given.locking).map(Into::into),
    }
}
