use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;

use crate::http::extract::{Body, Ids};
use crate::http::{AppState, Problem};
use prosopon_contract::{FrameDocument, FrameRequest, to_json};
use prosopon_jobs::frame_of;
use prosopon_session::SessionParts;
use prosopon_store::{PartKind, PartRecord, SessionId};

/// Read the frame of the head
///
/// Where the patient's left, back and top are in the scan. The service computes in this frame: templates, proposals, regions of the
/// face and the lattice of the mesh follow it, however the head lay in the scanner. It is estimated from skin and skull, unless a client
/// set it. `forward`, `down` and `left` in reports are its directions; all coordinates stay in LPS of the scan.
#[utoipa::path(get, path = "/v1/sessions/{session}/frame", operation_id = "getFrame", tag = "inputs", params(("session" = Uuid, Path)),
    responses((status = 200, description = "The frame.", body = FrameDocument)))]
pub(in crate::http) async fn get(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
) -> Result<Json<FrameDocument>, Problem> {
    let parts = SessionParts::load(state.service.store(), session).await?;
    Ok(Json(frame_of(&state.service, &parts).await?))
}

/// Set the frame of the head
///
/// Takes the place of the estimate, for a front-end's own frame or the natural head position. Fields, meshes and osteotomies made in another
/// frame become stale.
#[utoipa::path(put, path = "/v1/sessions/{session}/frame", operation_id = "putFrame", tag = "inputs", params(("session" = Uuid, Path)),
    request_body = FrameRequest,
    responses((status = 200, description = "The frame with exact axes.", body = FrameRequest)))]
pub(in crate::http) async fn put(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    Body(request): Body<FrameRequest>,
) -> Result<Json<FrameRequest>, Problem> {
    SessionParts::load(state.service.store(), session).await?;
    let frame = request.checked()?;
    let part = PartRecord::of_document(PartKind::Frame, to_json("the frame", &frame)?);
    state.service.store().put_parts(session, &[part]).await?;
    Ok(Json(frame))
}

/// Return to the estimated frame
///
/// Removes the frame that a client set. Answers 204 also when there is none.
#[utoipa::path(delete, path = "/v1/sessions/{session}/frame", operation_id = "deleteFrame", tag = "inputs", params(("session" = Uuid, Path)),
    responses((status = 204, description = "The frame is estimated again.")))]
pub(in crate::http) async fn delete(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
) -> Result<StatusCode, Problem> {
    SessionParts::load(state.service.store(), session).await?;
    state.service.store().delete_part(session, PartKind::Frame).await?;
    Ok(StatusCode::NO_CONTENT)
}
