use crate::http::Problem;
use prosopon_contract::{BudgetDocument, Fault, FaultKind, MeshRequest, PlanDocument, SolveRequest};
use prosopon_jobs::{Given, MeshChoice, Service, demand_of, is_kept};
use prosopon_planning::simulate::budget::{KnownMesh, Limits, choose};
use prosopon_session::{Kept, SessionParts};
use prosopon_store::PartKind;

/// Sets edge and formulation of a solve with a budget; `None` without one.
pub(super) fn keep_budget(
    service: &Service,
    parts: &SessionParts,
    request: &mut SolveRequest,
    mesh: &mut MeshChoice,
    plan: &PlanDocument,
    given: Given,
) -> Result<Option<BudgetDocument>, Problem> {
    let Some(asked) = request.budget else { return Ok(None) };
    let demand = demand_of(request, mesh, plan, given, known_mesh(service, parts, mesh)?);
    let least = |a: Option<f64>, b: Option<f64>| a.into_iter().chain(b).reduce(f64::min);
    let limits = Limits { error_mm: asked.max_error_mm, wall_s: least(asked.max_wall_s, request.max_wall_s) };
    let choice = choose(&demand, limits).ok_or_else(|| {
        let detail = "a budget is kept with `locking` none or patched, and with a mesh at least 11 mm deep";
        Fault::new(FaultKind::InvalidRequest, detail).at("/budget")
    })?;
    mesh.settings.edge_mm = choice.chosen.edge_mm;
    request.locking = Some(choice.chosen.locking.into());
    Ok(Some(BudgetDocument::new(asked, limits.wall_s, &choice, request.solved_model(), request.steps())))
}

/// The mesh that the session has, if it covers the same region.
fn known_mesh(service: &Service, parts: &SessionParts, wanted: &MeshChoice) -> Result<Option<KnownMesh>, Fault> {
    let (Some(part), Some(mesh)) = (parts.get(PartKind::Mesh), parts.mesh()?) else { return Ok(None) };
    let but_edge = |settings: &MeshRequest| MeshRequest { edge_mm: 0.0, osteotomy: None, ..settings.clone() };
    let is_alike = mesh.cuts == wanted.cuts && but_edge(&mesh.settings) == but_edge(&wanted.settings);
    if !is_alike {
        return Ok(None);
    }
    let key = parts.mesh_key(&mesh.settings, wanted.cuts.as_deref())?;
    let is_kept = is_kept(service, parts, Kept::Tissue, &key);
    Ok(Some(KnownMesh { edge_mm: mesh.settings.edge_mm, nodes: mesh.nodes, wall_s: part.wall_s, is_kept }))
}
