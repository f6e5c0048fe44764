use axum::Json;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::IntoParams;
use uuid::Uuid;

use crate::http::auth::Principal;
use crate::http::dto::{JobView, SessionList, SessionView};
use crate::http::extract::{CreateBody, Ids, Params, page_length};
use crate::http::{AppState, Problem};
use prosopon_contract::{CreateSession, FaultKind, to_json};
use prosopon_session::SessionParts;
use prosopon_store::{SessionId, SessionRecord, later, now_rfc3339};

/// Number of jobs in a session's view, newest first.
const MOST_JOBS: u32 = 100;

/// Page of a list of sessions.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct Page {
    /// Id of a session: lists only sessions created before it.
    before: Option<Uuid>,
    /// Largest number of sessions on the page, 1 to 100; 20 when absent.
    #[param(minimum = 1, maximum = 100)]
    limit: Option<u32>,
}

/// Create a session
///
/// A session holds the inputs, osteotomies, plans and jobs of one patient.
#[utoipa::path(post, path = "/v1/sessions", operation_id = "createSession", tag = "sessions", request_body = CreateSession,
    responses((status = 201, description = "The new session.", body = SessionView, headers(("Location" = String)))))]
pub(in crate::http) async fn create(
    State(state): State<AppState>,
    principal: Principal,
    creating: CreateBody<CreateSession>,
) -> Result<Response, Problem> {
    let (request, answering) = creating.split();
    let request = request.check()?;
    let record = SessionRecord {
        id: SessionId::new(),
        tenant: principal.tenant,
        label: request.label,
        settings: to_json("the session's settings", &request.settings)?,
        created_at: now_rfc3339(),
    };
    let view = SessionView::new(&record);
    let location = format!("/v1/sessions/{}", record.id);
    let answer = answering.remember(StatusCode::CREATED, &location, None, &view, record.id);
    state.service.store().insert_session(&record, answer.as_ref()).await?;
    Ok((StatusCode::CREATED, [(header::LOCATION, location)], Json(view)).into_response())
}

/// List sessions
///
/// Returns one page of sessions, newest first.
#[utoipa::path(get, path = "/v1/sessions", operation_id = "listSessions", tag = "sessions", params(Page),
    responses((status = 200, description = "One page.", body = SessionList)))]
pub(in crate::http) async fn list(
    State(state): State<AppState>,
    principal: Principal,
    Params(page): Params<Page>,
) -> Result<Json<SessionList>, Problem> {
    let limit = page_length(page.limit)?;
    let records =
        state.service.store().sessions(Some(&principal.tenant), page.before.map(SessionId::from), limit).await?;
    let next = records.last().filter(|_| records.len() == limit as usize);
    let next = next.map(|r| format!("/v1/sessions?before={}&limit={limit}", r.id));
    Ok(Json(SessionList { sessions: views(&state, &records).await?, next }))
}

/// Read a session
///
/// Returns the state of every part, and the session's osteotomies, plans and jobs.
#[utoipa::path(get, path = "/v1/sessions/{session}", operation_id = "getSession", tag = "sessions", params(("session" = Uuid, Path)),
    responses((status = 200, description = "The session.", body = SessionView)))]
pub(in crate::http) async fn get(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
) -> Result<Json<SessionView>, Problem> {
    let gone = || Problem::new(FaultKind::Gone, "the session was deleted while it was read");
    let Some(record) = state.service.store().session(session).await? else {
        // Fails with not-found or gone.
        SessionParts::load(state.service.store(), session).await?;
        return Err(gone());
    };
    let mut view = views(&state, &[record]).await?.pop().ok_or_else(gone)?;
    view.expires_at = expires_at(&state, session).await?;
    Ok(Json(view))
}

/// Options for deleting a session.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct Deletion {
    /// Whether to delete the session immediately and permanently; false when absent.
    #[serde(default)]
    at_once: bool,
}

/// Delete a session
///
/// Deletes the session with everything in it and cancels its jobs. Afterwards its paths answer 410 and lists omit it.
///
/// `POST …/restore` restores it within one day, or within the time that the service's setting `deleted_retention_s` gives.
/// After that time it is deleted permanently. `at_once=true` deletes it permanently at once, even if it was deleted before.
#[utoipa::path(delete, path = "/v1/sessions/{session}", operation_id = "deleteSession", tag = "sessions", params(("session" = Uuid, Path), Deletion),
    responses((status = 204, description = "Deleted.")))]
pub(in crate::http) async fn delete(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    Params(deletion): Params<Deletion>,
) -> Result<StatusCode, Problem> {
    SessionParts::load(state.service.store(), session).await?;
    let is_gone = if deletion.at_once {
        state.service.delete_session(session).await?
    } else {
        state.service.hide_session(session).await?
    };
    if is_gone {
        Ok(StatusCode::NO_CONTENT)
    } else {
        Err(Problem::new(FaultKind::Gone, format!("session {session} was deleted")))
    }
}

/// Restore a session
///
/// Restores a deleted session with everything in it, within one day of the deletion or the time that the service's setting
/// `deleted_retention_s` gives. Jobs that the deletion cancelled stay cancelled.
#[utoipa::path(post, path = "/v1/sessions/{session}/restore", operation_id = "restoreSession", tag = "sessions", params(("session" = Uuid, Path)),
    responses((status = 200, description = "The session.", body = SessionView)))]
pub(in crate::http) async fn restore(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
) -> Result<Json<SessionView>, Problem> {
    let is_there = state.service.store().session(session).await?.is_some();
    if !state.service.store().restore_session(session).await? {
        return Err(if is_there {
            Problem::new(
                FaultKind::WrongState,
                format!("session {session} is not deleted, so there is nothing to restore"),
            )
        } else {
            Problem::new(FaultKind::Gone, format!("session {session} was deleted permanently and cannot be restored"))
        });
    }
    get(State(state), Ids(session)).await
}

/// When the session will be deleted if it is not used.
async fn expires_at(state: &AppState, session: SessionId) -> Result<Option<String>, Problem> {
    let Some(retention) = state.service.settings().session_retention else { return Ok(None) };
    let used = state.service.store().last_used(session).await?;
    Ok(used.and_then(|used| later(&used, retention)))
}

/// Views of sessions with their contents. Sessions that were deleted in the meantime are left out.
async fn views(state: &AppState, records: &[SessionRecord]) -> Result<Vec<SessionView>, Problem> {
    let ids: Vec<SessionId> = records.iter().map(|record| record.id).collect();
    let mut contents = state.service.store().contents(&ids, MOST_JOBS).await?;
    let (mut views, mut jobs) = (Vec::new(), Vec::new());
    for record in records {
        let Some(held) = contents.remove(&record.id) else { continue };
        let mut view = SessionView::new(record);
        view.fill_parts(&SessionParts::of(record.id, held.parts), &held.jobs);
        view.bytes = held.bytes;
        view.osteotomies = held.osteotomies.iter().map(|id| id.uuid()).collect();
        view.plans = held.plans.iter().map(|id| id.uuid()).collect();
        views.push((held.jobs.len(), view));
        jobs.extend(held.jobs);
    }
    let mut jobs = state.service.statuses_of(jobs).await?.into_iter();
    let fill = |(count, view): (usize, SessionView)| SessionView {
        jobs: jobs.by_ref().take(count).map(|job| JobView::from(&job)).collect(),
        ..view
    };
    Ok(views.into_iter().map(fill).collect())
}
