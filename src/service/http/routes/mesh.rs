use axum::Json;
use axum::extract::State;
use axum::response::Response;

use super::accepted::accept;
use super::jobs::session_settings;
use super::osteotomies::current_osteotomy;
use crate::http::dto::{JobView, MeshView, view_of};
use crate::http::extract::{CreateBody, Ids};
use crate::http::{AppState, Problem};
use prosopon_contract::{MeshDocument, MeshRequest};
use prosopon_jobs::MeshTask;
use prosopon_session::SessionParts;
use prosopon_store::{JobFilter, JobKind, OsteotomyId, PartKind, SessionId};

/// Build the tissue mesh
///
/// Starts a `mesh` job. The mesh has prisms in the skin layer and tetrahedra inside. The session needs distance fields.
#[utoipa::path(post, path = "/v1/sessions/{session}/mesh", operation_id = "buildMesh", tag = "mesh", params(("session" = Uuid, Path)),
    request_body = MeshRequest,
    responses((status = 202, description = "The job.", body = JobView, headers(("Location" = String), ("Retry-After" = u32)))))]
pub(in crate::http) async fn build(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    creating: CreateBody<MeshRequest>,
) -> Result<Response, Problem> {
    let (request, answering) = creating.split();
    let parts = SessionParts::load(state.service.store(), session).await?;
    let settings = request.checked()?;
    let defaults = session_settings(&state, session).await?;
    parts.require_field()?;
    let osteotomy_id = settings.osteotomy.map(OsteotomyId::from);
    let cuts = match osteotomy_id {
        Some(id) => Some(current_osteotomy(&state, &parts, session, id, "/osteotomy").await?.1.cuts),
        None => None,
    };
    let key = parts.mesh_key(&settings, cuts.as_deref())?;
    let request = MeshTask { settings, cuts, osteotomy_id, preset: defaults.preset.unwrap_or_default(), key };
    accept(&state, session, JobKind::Mesh, &request, Some(&answering)).await
}

/// Read the tissue mesh's report
///
/// Returns the state and the quality report of the last build.
#[utoipa::path(get, path = "/v1/sessions/{session}/mesh", operation_id = "getMesh", tag = "mesh", params(("session" = Uuid, Path)),
    responses((status = 200, description = "State and report.", body = MeshView)))]
pub(in crate::http) async fn get(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
) -> Result<Json<MeshView>, Problem> {
    let parts = SessionParts::load(state.service.store(), session).await?;
    let filter = JobFilter { session: Some(session), limit: 100, ..JobFilter::default() };
    let jobs = state.service.store().jobs(&filter).await?;
    let report = parts.mesh()?.map(|mesh| MeshDocument { cuts: None, ..mesh });
    Ok(Json(MeshView { part: view_of(PartKind::Mesh, &parts, &jobs), report }))
}
