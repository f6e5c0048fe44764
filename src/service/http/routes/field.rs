use axum::Json;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::ToSchema;

use super::accepted::accept;
use crate::http::dto::{FieldView, JobView, PointQuery, PointValues, SliceQuery, view_of};
use crate::http::extract::{Body, CreateBody, Ids, Params};
use crate::http::{AppState, Problem};
use prosopon_contract::{FieldSettingsDocument, to_json};
use prosopon_jobs::{FieldTask, case_of, field_slice};
use prosopon_session::SessionParts;
use prosopon_store::{JobFilter, JobKind, PartKind, PartRecord, SessionId};

/// An empty request.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::http) struct EmptyBody {}

/// Set the field settings
///
/// The settings apply to the next build. Fields that were built with other settings become stale.
#[utoipa::path(put, path = "/v1/sessions/{session}/field/settings", operation_id = "putFieldSettings", tag = "field", params(("session" = Uuid, Path)),
    request_body = FieldSettingsDocument,
    responses((status = 200, description = "All settings, with defaults.", body = FieldSettingsDocument)))]
pub(in crate::http) async fn put_settings(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    Body(request): Body<FieldSettingsDocument>,
) -> Result<Json<FieldSettingsDocument>, Problem> {
    SessionParts::load(state.service.store(), session).await?;
    let settings = request.checked()?;
    let part = PartRecord::of_document(PartKind::FieldSettings, to_json("the settings of the fields", &settings)?);
    state.service.store().put_parts(session, &[part]).await?;
    Ok(Json(settings))
}

/// Build the distance fields
///
/// Starts a `field` job that builds the signed distance fields of skin and bone. The session needs skin and skull.
#[utoipa::path(post, path = "/v1/sessions/{session}/field", operation_id = "buildField", tag = "field", params(("session" = Uuid, Path)),
    request_body(content = Option<EmptyBody>, description = "The body may be absent."),
    responses((status = 202, description = "The job.", body = JobView, headers(("Location" = String), ("Retry-After" = u32)))))]
pub(in crate::http) async fn build(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    creating: CreateBody<EmptyBody>,
) -> Result<Response, Problem> {
    let (EmptyBody {}, answering) = creating.split();
    let parts = SessionParts::load(state.service.store(), session).await?;
    parts.require_nested()?;
    let request = FieldTask { settings: parts.field_settings()?, key: parts.field_key()? };
    accept(&state, session, JobKind::Field, &request, Some(&answering)).await
}

/// Read the fields' report
///
/// Returns state and settings, and memory, cell count and measured error of the last build.
#[utoipa::path(get, path = "/v1/sessions/{session}/field", operation_id = "getField", tag = "field", params(("session" = Uuid, Path)),
    responses((status = 200, description = "State and report.", body = FieldView)))]
pub(in crate::http) async fn get(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
) -> Result<Json<FieldView>, Problem> {
    let parts = SessionParts::load(state.service.store(), session).await?;
    let filter = JobFilter { session: Some(session), limit: 100, ..JobFilter::default() };
    let jobs = state.service.store().jobs(&filter).await?;
    let report = parts.get(PartKind::Field).and_then(|p| serde_json::from_str(&p.document).ok());
    Ok(Json(FieldView { part: view_of(PartKind::Field, &parts, &jobs), settings: parts.field_settings()?, report }))
}

/// Draw a slice of a field
///
/// Returns a PNG picture: blue inside, red outside, black at the surface.
#[utoipa::path(get, path = "/v1/sessions/{session}/field/slice.png", operation_id = "getFieldSlice", tag = "field",
    params(("session" = Uuid, Path), SliceQuery),
    responses((status = 200, description = "The picture.", body = Vec<u8>, content_type = "image/png")))]
pub(in crate::http) async fn slice(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    Params(query): Params<SliceQuery>,
) -> Result<Response, Problem> {
    let (solid, axis, offset_mm) = query.check()?;
    let parts = SessionParts::load(state.service.store(), session).await?;
    parts.require_field()?;
    let case = case_of(&state.service, &parts).await?;
    let png = field_slice(&state.service, case, solid, axis, offset_mm).await?;
    Ok(([(header::CONTENT_TYPE, "image/png")], png).into_response())
}

/// Evaluate a field at points
///
/// Returns signed distances, gradients and closest points. The winding number gives the sign.
#[utoipa::path(post, path = "/v1/sessions/{session}/field/query", operation_id = "queryField", tag = "field", params(("session" = Uuid, Path)),
    request_body = PointQuery, responses((status = 200, description = "Values in the order of the points.", body = PointValues)))]
pub(in crate::http) async fn query(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    Body(request): Body<PointQuery>,
) -> Result<Json<PointValues>, Problem> {
    let (solid, points) = request.check()?;
    let parts = SessionParts::load(state.service.store(), session).await?;
    parts.require_field()?;
    let case = case_of(&state.service, &parts).await?;
    let values = state.service.compute(move |engine, control| engine.nearest(&case, solid, &points, control)).await?;
    Ok(Json(PointValues {
        distances_mm: values.iter().map(|v| v.distance).collect(),
        gradients: values.iter().map(|v| v.gradient.into()).collect(),
        closest_points_mm: values.iter().map(|v| v.closest.into()).collect(),
        triangles: values.iter().map(|v| v.triangle).collect(),
    }))
}
