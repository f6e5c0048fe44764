use axum::Json;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};

use super::inputs::{InputQuery, put, send};
use crate::http::dto::UploadForm;
use crate::http::extract::{Ids, Params};
use crate::http::result::{tag_of, tagged};
use crate::http::upload::receive;
use crate::http::{AppState, Problem};
use prosopon_contract::{FaultKind, SurfaceDocument, TissueDocument};
use prosopon_formats::import::is_legacy_vtk;
use prosopon_jobs::take_tissue;
use prosopon_session::{SessionParts, read_part};
use prosopon_store::{PartKind, SessionId};

/// Upload a tissue mesh
///
/// A VTU or legacy VTK file (ASCII or binary) of tetrahedra (type 10) and wedges (type 13), LPS mm. It replaces an earlier
/// upload. Solves of the session use this mesh, and the service meshes nothing.
///
/// The cell array `tissue` is required: 0 skin, 1 muscle, 2 fat, 3 mucosa, 4 cartilage. The point arrays are optional: `attachment` (-1
/// free, 0 skull, k segment k, -2 sliding, -3 - k gliding on segment k), `fixed_mask` (axes along which a point is held: bits x 1, y 2, z 4),
/// `prescribed_mm` (displacement along these axes, three components, mm), `force_n` (dead load, N).
#[utoipa::path(put, path = "/v1/sessions/{session}/tissue", operation_id = "putTissue", tag = "inputs", params(("session" = Uuid, Path)),
    request_body(content(
        (Vec<u8> = "application/vnd.vtk.vtu"), (Vec<u8> = "application/octet-stream"), (UploadForm = "multipart/form-data"))),
    responses((status = 200, description = "Report of the mesh.", body = TissueDocument)))]
pub(in crate::http) async fn put_tissue(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    headers: HeaderMap,
    body: Body,
) -> Result<Json<TissueDocument>, Problem> {
    let store = state.service.store();
    SessionParts::load(store, session).await?;
    let limit = state.limits.max_surface_bytes;
    let upload = receive(store, session, &headers, body, limit, &state.limits, None).await?;
    Ok(Json(take_tissue(&state.service, session, upload.blob).await?))
}

/// Format in which to send an uploaded tissue mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::http) enum TissueOutput {
    /// The file as uploaded: VTU, or legacy VTK as `application/octet-stream`.
    Vtu,
    /// The report of the mesh.
    Json,
}

/// Which format to send.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct TissueQuery {
    /// Format of the answer; `vtu` when absent.
    #[param(inline)]
    format: Option<TissueOutput>,
}

/// Read the uploaded tissue mesh
///
/// Returns the file as uploaded, or its report.
#[utoipa::path(get, path = "/v1/sessions/{session}/tissue", operation_id = "getTissue", tag = "inputs", params(("session" = Uuid, Path), TissueQuery),
    responses((status = 200, description = "The mesh or its report.", content(
        (Vec<u8> = "application/vnd.vtk.vtu"), (Vec<u8> = "application/octet-stream"), (TissueDocument = "application/json"))), (status = 304, description = "Not modified.")))]
pub(in crate::http) async fn get_tissue(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    Params(query): Params<TissueQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let parts = SessionParts::load(state.service.store(), session).await?;
    let part = parts.require(PartKind::Tissue)?;
    if query.format == Some(TissueOutput::Json) {
        let tag = tag_of(&[&part.key, "report"]);
        return tagged(&headers, &tag, "application/json", part.document.clone().into());
    }
    let bytes = read_part(state.service.store(), part).await?;
    let kind = if is_legacy_vtk(&bytes) { "application/octet-stream" } else { "application/vnd.vtk.vtu" };
    tagged(&headers, &format!("\"{}\"", part.key), kind, bytes)
}

/// Remove the uploaded tissue mesh
///
/// Solves of the session then use the mesh that the service builds.
#[utoipa::path(delete, path = "/v1/sessions/{session}/tissue", operation_id = "deleteTissue", tag = "inputs", params(("session" = Uuid, Path)),
    responses((status = 204, description = "Removed.")))]
pub(in crate::http) async fn delete_tissue(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
) -> Result<StatusCode, Problem> {
    remove(&state, session, PartKind::Tissue).await
}

async fn remove(state: &AppState, session: SessionId, kind: PartKind) -> Result<StatusCode, Problem> {
    SessionParts::load(state.service.store(), session).await?.require(kind)?;
    state.service.store().delete_part(session, kind).await?;
    Ok(StatusCode::NO_CONTENT)
}

fn bone_kind(segment: u32) -> Result<PartKind, Problem> {
    let detail = format!("only segments 0 to {} can have a bone; name one of them", PartKind::BONES - 1);
    PartKind::bone(segment).ok_or_else(|| Problem::new(FaultKind::NotFound, detail))
}

/// Upload the rigid bone of a segment
///
/// A surface in STL, PLY, OBJ or VTP format, LPS mm, at rest, for segment 0 (fixed) to 9. Points of the uploaded tissue mesh
/// with `attachment` -2 slide on these bones.
#[utoipa::path(put, path = "/v1/sessions/{session}/bones/{segment}", operation_id = "putBone", tag = "inputs",
    params(("session" = Uuid, Path), ("segment" = u32, Path)),
    request_body(content((Vec<u8> = "application/octet-stream"), (UploadForm = "multipart/form-data"))),
    responses((status = 200, description = "Report of the surface.", body = SurfaceDocument)))]
pub(in crate::http) async fn put_bone(
    State(state): State<AppState>,
    Ids((session, segment)): Ids<(SessionId, u32)>,
    headers: HeaderMap,
    body: Body,
) -> Result<Json<SurfaceDocument>, Problem> {
    put(&state, session, bone_kind(segment)?, &headers, body).await
}

/// Read the rigid bone of a segment
///
/// Returns the surface that was uploaded for the tissue mesh, or its report.
#[utoipa::path(get, path = "/v1/sessions/{session}/bones/{segment}", operation_id = "getBone", tag = "inputs",
    params(("session" = Uuid, Path), ("segment" = u32, Path), InputQuery),
    responses((status = 200, description = "The surface or its report.", content(
        (Vec<u8> = "model/gltf-binary"), (Vec<u8> = "application/ply"), (Vec<u8> = "model/stl"),
        (SurfaceDocument = "application/json"))), (status = 304, description = "Not modified.")))]
pub(in crate::http) async fn get_bone(
    State(state): State<AppState>,
    Ids((session, segment)): Ids<(SessionId, u32)>,
    Params(query): Params<InputQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    send(&state, session, bone_kind(segment)?, &query, &headers).await
}

/// Remove the rigid bone of a segment
///
/// Deletes the bone that was uploaded for the tissue mesh.
#[utoipa::path(delete, path = "/v1/sessions/{session}/bones/{segment}", operation_id = "deleteBone", tag = "inputs",
    params(("session" = Uuid, Path), ("segment" = u32, Path)),
    responses((status = 204, description = "Removed.")))]
pub(in crate::http) async fn delete_bone(
    State(state): State<AppState>,
    Ids((session, segment)): Ids<(SessionId, u32)>,
) -> Result<StatusCode, Problem> {
    remove(&state, session, bone_kind(segment)?).await
}
