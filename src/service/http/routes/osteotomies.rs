use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::results::{FormatQuery, send_surface};
use crate::http::dto::{OsteotomyList, OsteotomyPreview, OsteotomyView, TemplateList};
use crate::http::extract::{Body, CreateBody, Ids, Params};
use crate::http::surface_format::SurfaceOutput;
use crate::http::{AppState, Problem};
use prosopon_contract::{CreateOsteotomy, CutDocument, Fault, FaultKind, OsteotomyDocument, from_json};
use prosopon_formats::export::SurfaceView;
use prosopon_geometry::Warning;
use prosopon_jobs::{cut_bone, place_cuts};
use prosopon_session::SessionParts;
use prosopon_store::{OsteotomyId, OsteotomyRecord, SessionId, decode_mesh};

/// Cut the bone
///
/// Cuts the bone by planes, polylines, surfaces and templates, in any combination. The session needs skin and skull.
#[utoipa::path(post, path = "/v1/sessions/{session}/osteotomies", operation_id = "createOsteotomy", tag = "bone", params(("session" = Uuid, Path)),
    request_body = CreateOsteotomy,
    responses((status = 201, description = "Cuts and segments.", body = OsteotomyView, headers(("Location" = String)))))]
pub(in crate::http) async fn create(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    creating: CreateBody<CreateOsteotomy>,
) -> Result<Response, Problem> {
    let (request, answering) = creating.split();
    let parts = SessionParts::load(state.service.store(), session).await?;
    let is_single = request.template.is_some();
    let (label, cuts) = request.check(parts.landmarks()?.as_ref())?;
    let cut = cut_bone(&state.service, session, &parts, cuts, label).await;
    let (record, content) = cut.map_err(|fault| if is_single { of_single(fault) } else { fault })?;
    let view = OsteotomyView::new(&record, content, Some(&record.field_key));
    let location = format!("/v1/sessions/{session}/osteotomies/{}", record.id);
    let answer = answering.remember(StatusCode::CREATED, &location, None, &view, session);
    state.service.store().insert_osteotomy(&record, answer.as_ref()).await?;
    Ok((StatusCode::CREATED, [(header::LOCATION, location)], Json(view)).into_response())
}

/// Preview the cuts of an osteotomy
///
/// Returns the cuts that the same request to `createOsteotomy` would make, without cutting or storing anything. Move them and
/// send them as `cuts`. Warnings say where a cut misses the bone and where the cuts do not part it. Distances to protected
/// structures show only when the bone is cut; a warning says so where the request has `protected`. The session needs skin and skull.
#[utoipa::path(post, path = "/v1/sessions/{session}/osteotomies/preview", operation_id = "previewOsteotomy", tag = "bone",
    params(("session" = Uuid, Path)), request_body = CreateOsteotomy,
    responses((status = 200, description = "The cuts.", body = OsteotomyPreview)))]
pub(in crate::http) async fn preview(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    Body(request): Body<CreateOsteotomy>,
) -> Result<Json<OsteotomyPreview>, Problem> {
    let parts = SessionParts::load(state.service.store(), session).await?;
    let is_single = request.template.is_some();
    let is_guarded = !request.protected.is_empty();
    let (_, cuts) = request.check(parts.landmarks()?.as_ref())?;
    let placed = place_cuts(&state.service, &parts, cuts).await;
    let (cuts, mut warnings) = placed.map_err(|fault| if is_single { of_single(fault) } else { fault })?;
    if is_guarded {
        let message = "the distances of the cuts to protected structures are not in a preview";
        warnings.push(Warning::check("distances-not-measured", message).act("Cut the bone to see them."));
    }
    let cuts = cuts.iter().map(CutDocument::from).collect();
    Ok(Json(OsteotomyPreview { cuts, findings: warnings.into_iter().collect() }))
}

/// List osteotomy templates
///
/// Returns all templates with the landmarks that they need, and those that improve their cuts.
#[utoipa::path(get, path = "/v1/templates", operation_id = "listTemplates", tag = "bone",
    responses((status = 200, description = "All templates.", body = TemplateList)))]
pub(in crate::http) async fn templates() -> Json<TemplateList> {
    Json(TemplateList::all())
}

/// Points errors to `/template` instead of `/templates/0`, as the request names it.
fn of_single(mut fault: Fault) -> Fault {
    for error in &mut fault.errors {
        let below = error.pointer.strip_prefix("/templates").map(|rest| rest.strip_prefix("/0").unwrap_or(rest));
        if let Some(below) = below {
            error.pointer = format!("/template{below}");
        }
    }
    fault
}

/// List osteotomies
///
/// Returns all osteotomies of the session, oldest first.
#[utoipa::path(get, path = "/v1/sessions/{session}/osteotomies", operation_id = "listOsteotomies", tag = "bone", params(("session" = Uuid, Path)),
    responses((status = 200, description = "All osteotomies.", body = OsteotomyList)))]
pub(in crate::http) async fn list(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
) -> Result<Json<OsteotomyList>, Problem> {
    let parts = SessionParts::load(state.service.store(), session).await?;
    let records = state.service.store().osteotomies(session).await?;
    let osteotomies = records.iter().map(|r| view(r, &parts)).collect::<Result<_, _>>()?;
    Ok(Json(OsteotomyList { osteotomies }))
}

/// Read an osteotomy
///
/// Returns its cuts, segments and warnings.
#[utoipa::path(get, path = "/v1/sessions/{session}/osteotomies/{osteotomy}", operation_id = "getOsteotomy", tag = "bone",
    params(("session" = Uuid, Path), ("osteotomy" = Uuid, Path)),
    responses((status = 200, description = "Cuts and segments.", body = OsteotomyView)))]
pub(in crate::http) async fn get(
    State(state): State<AppState>,
    Ids((session, osteotomy)): Ids<(SessionId, OsteotomyId)>,
) -> Result<Json<OsteotomyView>, Problem> {
    let parts = SessionParts::load(state.service.store(), session).await?;
    Ok(Json(view(&find(&state, session, osteotomy).await?, &parts)?))
}

/// Delete an osteotomy
///
/// Deletes the osteotomy and its plans. Jobs keep their own copies.
#[utoipa::path(delete, path = "/v1/sessions/{session}/osteotomies/{osteotomy}", operation_id = "deleteOsteotomy", tag = "bone",
    params(("session" = Uuid, Path), ("osteotomy" = Uuid, Path)),
    responses((status = 204, description = "Deleted.")))]
pub(in crate::http) async fn delete(
    State(state): State<AppState>,
    Ids((session, osteotomy)): Ids<(SessionId, OsteotomyId)>,
) -> Result<StatusCode, Problem> {
    find(&state, session, osteotomy).await?;
    state.service.store().delete_osteotomy(session, osteotomy).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Read the surface of a segment
///
/// Returns the segment's closed surface at rest, with caps on the cuts.
#[utoipa::path(get, path = "/v1/sessions/{session}/osteotomies/{osteotomy}/segments/{segment}", operation_id = "getSegment", tag = "bone",
    params(("session" = Uuid, Path), ("osteotomy" = Uuid, Path), ("segment" = u32, Path), FormatQuery),
    responses((status = 200, description = "The surface.", content(
        (Vec<u8> = "model/gltf-binary"), (Vec<u8> = "application/ply"), (Vec<u8> = "model/stl"),
        (Vec<u8> = "application/vnd.vtk.vtp"))),
        (status = 304, description = "Not modified.")))]
pub(in crate::http) async fn segment(
    State(state): State<AppState>,
    Ids((session, osteotomy, segment)): Ids<(SessionId, OsteotomyId, u32)>,
    Params(query): Params<FormatQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let record = find(&state, session, osteotomy).await?;
    let missing = || Problem::new(FaultKind::NotFound, format!("the osteotomy has no segment {segment}"));
    let blob = record.blobs.get(segment as usize).cloned().ok_or_else(missing)?;
    let format = SurfaceOutput::choose(query.format, &headers)?;
    let store = state.service.store().clone();
    let key = blob.clone();
    send_surface(&state, &headers, format, &[&key], async move {
        let mesh = decode_mesh(&store.blobs().get(&blob).await?)?;
        Ok(move || format.write(&SurfaceView { mesh: &mesh, scalars: &[], colours: None }))
    })
    .await
}

pub(super) async fn find(state: &AppState, session: SessionId, id: OsteotomyId) -> Result<OsteotomyRecord, Problem> {
    SessionParts::load(state.service.store(), session).await?;
    match state.service.store().osteotomy(session, id).await? {
        Some(record) => Ok(record),
        None if state.service.store().is_deleted(&id.to_string()).await? => {
            Err(Problem::new(FaultKind::Gone, format!("osteotomy {id} was deleted")))
        }
        None => Err(Problem::new(FaultKind::NotFound, format!("the session has no osteotomy {id}"))),
    }
}

/// The osteotomy that a request names; fails with stale if the bone has changed since the cut.
pub(super) async fn current_osteotomy(
    state: &AppState,
    parts: &SessionParts,
    session: SessionId,
    id: OsteotomyId,
    pointer: &str,
) -> Result<(OsteotomyRecord, OsteotomyDocument), Problem> {
    let record = match find(state, session, id).await {
        Ok(record) => record,
        // The id is in the body, so the value is wrong and not the path.
        Err(Problem(fault)) => return Err(Fault { kind: FaultKind::InvalidRequest, ..fault.at(pointer) }.into()),
    };
    if record.field_key != parts.field_key()? {
        let detail = "bone or field settings have changed since the osteotomy was cut; cut again";
        return Err(Fault::new(FaultKind::Stale, detail).with("stale", "osteotomy").into());
    }
    let content = content(&record)?;
    Ok((record, content))
}

fn content(record: &OsteotomyRecord) -> Result<OsteotomyDocument, Problem> {
    Ok(from_json("the osteotomy", &record.document)?)
}

fn view(record: &OsteotomyRecord, parts: &SessionParts) -> Result<OsteotomyView, Problem> {
    Ok(OsteotomyView::new(record, content(record)?, parts.field_key().ok().as_deref()))
}
