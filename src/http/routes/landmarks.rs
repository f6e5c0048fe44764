use axum::Json;
use axum::extract::State;

use crate::http::dto::PutLandmarks;
use crate::http::extract::{Body, Ids};
use crate::http::{AppState, Problem};
use crate::session::{FaultKind, LandmarksDocument, SessionParts};
use crate::store::{PartKind, PartRecord, SessionId, now_rfc3339, sha256_hex};

/// Set the landmarks
///
/// They place templates, regions of the face and where tissue slides.
#[utoipa::path(put, path = "/v1/sessions/{session}/landmarks", tag = "inputs", params(("session" = Uuid, Path)),
    request_body = PutLandmarks, responses((status = 200, description = "as stored", body = LandmarksDocument)))]
pub(in crate::http) async fn put(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    Body(request): Body<PutLandmarks>,
) -> Result<Json<LandmarksDocument>, Problem> {
    SessionParts::load(state.service.store(), session).await?;
    let landmarks = LandmarksDocument::try_from(request)?;
    let document = serde_json::to_string(&landmarks).unwrap_or_default();
    let part = PartRecord {
        kind: PartKind::Landmarks,
        key: sha256_hex(document.as_bytes()),
        blob: None,
        bytes: document.len() as u64,
        wall_s: 0.0,
        document,
        updated_at: now_rfc3339(),
    };
    state.service.store().put_parts(session, &[part]).await?;
    Ok(Json(landmarks))
}

/// The landmarks
#[utoipa::path(get, path = "/v1/sessions/{session}/landmarks", tag = "inputs", params(("session" = Uuid, Path)),
    responses((status = 200, description = "as stored", body = LandmarksDocument)))]
pub(in crate::http) async fn get(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
) -> Result<Json<LandmarksDocument>, Problem> {
    let parts = SessionParts::load(state.service.store(), session).await?;
    let missing = || Problem::new(FaultKind::NotFound, "the session has no landmarks yet");
    Ok(Json(parts.landmarks()?.ok_or_else(missing)?))
}
