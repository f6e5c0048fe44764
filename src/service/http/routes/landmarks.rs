use axum::Json;
use axum::extract::State;

use crate::http::dto::{LandmarksQuery, UploadForm};
use crate::http::extract::{Ids, LandmarksBody, Params};
use crate::http::{AppState, Problem};
use prosopon_contract::{FaultKind, LandmarksDocument, to_json};
use prosopon_jobs::{landmark_warnings, propose_landmarks};
use prosopon_session::SessionParts;
use prosopon_store::{PartKind, PartRecord, SessionId};

/// Set the landmarks
///
/// Landmarks place osteotomy templates, regions of the face and the boxes in which tissue slides. They replace all landmarks
/// stored before.
///
/// The body is this document, or a landmark file of 3D Slicer (`.mrk.json` or `.fcsv`), as it is or in a form with one file. The
/// service detects it from the bytes, translates labels such as `ANS`, `Pog'` or `Go (L)` to its names, converts RAS to LPS, and
/// says so in `notes` and `warnings`. Two labels of one landmark are refused.
///
/// The answer also has warnings about points that lie off the session's skin or skull, or are not arranged as in a head. Jobs
/// repeat them.
#[utoipa::path(put, path = "/v1/sessions/{session}/landmarks", operation_id = "putLandmarks", tag = "inputs", params(("session" = Uuid, Path)),
    request_body(content((LandmarksDocument = "application/json"), (String = "text/csv"), (UploadForm = "multipart/form-data"))),
    responses((status = 200, description = "The stored landmarks.", body = LandmarksDocument)))]
pub(in crate::http) async fn put(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    body: LandmarksBody,
) -> Result<Json<LandmarksDocument>, Problem> {
    let parts = SessionParts::load(state.service.store(), session).await?;
    let mut landmarks = body.landmarks.checked()?;
    landmarks.note(body.findings);
    let part = PartRecord::of_document(PartKind::Landmarks, to_json("the landmarks", &landmarks)?);
    state.service.store().put_parts(session, &[part]).await?;
    landmarks.warnings.extend(landmark_warnings(&state.service, &parts, &landmarks).await?);
    Ok(Json(landmarks))
}

/// Read the landmarks
///
/// With `propose=true` the answer adds proposals for the landmarks of the templates, computed from skin and bone and named in
/// `proposed`. They are midline points, lingula, buccal point and cheek bone point of each side, the occlusal plane and the Le
/// Fort I plane. Check them and PUT the correct ones. Proposals need skin and skull.
#[utoipa::path(get, path = "/v1/sessions/{session}/landmarks", operation_id = "getLandmarks", tag = "inputs",
    params(("session" = Uuid, Path), LandmarksQuery),
    responses((status = 200, description = "The landmarks, with proposals on request.", body = LandmarksDocument)))]
pub(in crate::http) async fn get(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    Params(query): Params<LandmarksQuery>,
) -> Result<Json<LandmarksDocument>, Problem> {
    let parts = SessionParts::load(state.service.store(), session).await?;
    if query.propose {
        let proposal = propose_landmarks(&state.service, &parts).await?;
        return Ok(Json(parts.landmarks()?.unwrap_or_default().with_proposals(&proposal)));
    }
    let missing = || Problem::new(FaultKind::NotFound, "the session has no landmarks; PUT them, or use propose=true");
    Ok(Json(parts.landmarks()?.ok_or_else(missing)?))
}
