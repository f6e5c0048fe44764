use axum::Json;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::osteotomies::fresh_osteotomy;
use crate::http::dto::{CreatePlan, PlanList, PlanView, Segments};
use crate::http::extract::{Creating, Ids};
use crate::http::{AppState, Problem};
use prosopon_jobs::make_plan;
use prosopon_session::{FaultKind, PlanDocument, SessionParts, stored_cuts};
use prosopon_store::{OsteotomyId, PlanId, PlanRecord, SessionId, now_rfc3339};

/// Plan where the bone goes
///
/// Paths are rigid and joined by screw motions. The answer says what they meet; without an osteotomy, on a ready tissue mesh, it does not.
#[utoipa::path(post, path = "/v1/sessions/{session}/plans", tag = "bone", params(("session" = Uuid, Path)),
    request_body = CreatePlan,
    responses((status = 201, description = "the plan", body = PlanView, headers(("Location" = String)))))]
pub(in crate::http) async fn create(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    creating: Creating<CreatePlan>,
) -> Result<Response, Problem> {
    let (request, answering) = creating.split();
    let parts = SessionParts::load(state.service.store(), session).await?;
    let osteotomy = request.osteotomy.map(OsteotomyId::from);
    let content = match osteotomy {
        Some(osteotomy) => {
            let (_, bone) = fresh_osteotomy(&state, &parts, session, osteotomy, "/osteotomy").await?;
            let (label, plan) = request.check(&Segments::from(&bone).with_landmarks(parts.landmarks()?))?;
            make_plan(&state.service, &parts, stored_cuts(&bone.cuts)?, plan, label).await?
        }
        None => {
            let tissue = parts.require_tissue("name an osteotomy, or PUT the tissue first")?;
            let (label, plan) =
                request.check(&Segments::of_tissue(&tissue, &parts.bone_keys()).with_landmarks(parts.landmarks()?))?;
            PlanDocument {
                label,
                paths: PlanDocument::paths_of(&plan),
                reports: Vec::new(),
                warnings: Vec::new(),
                wall_s: 0.0,
            }
        }
    };
    let record = PlanRecord {
        id: PlanId::new(),
        session,
        osteotomy,
        document: serde_json::to_string(&content).unwrap_or_default(),
        created_at: now_rfc3339(),
    };
    let view = PlanView::new(&record, content);
    let location = format!("/v1/sessions/{session}/plans/{}", record.id);
    let answer = answering.remember(StatusCode::CREATED, &location, None, &view, session);
    state.service.store().insert_plan(&record, answer.as_ref()).await?;
    Ok((StatusCode::CREATED, [(header::LOCATION, location)], Json(view)).into_response())
}

/// List plans
#[utoipa::path(get, path = "/v1/sessions/{session}/plans", tag = "bone", params(("session" = Uuid, Path)),
    responses((status = 200, description = "oldest first", body = PlanList)))]
pub(in crate::http) async fn list(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
) -> Result<Json<PlanList>, Problem> {
    SessionParts::load(state.service.store(), session).await?;
    let records = state.service.store().plans(session).await?;
    let plans = records.iter().map(|r| Ok(PlanView::new(r, content(r)?))).collect::<Result<_, Problem>>()?;
    Ok(Json(PlanList { plans }))
}

/// A plan
#[utoipa::path(get, path = "/v1/sessions/{session}/plans/{plan}", tag = "bone",
    params(("session" = Uuid, Path), ("plan" = Uuid, Path)),
    responses((status = 200, description = "the plan", body = PlanView)))]
pub(in crate::http) async fn get(
    State(state): State<AppState>,
    Ids((session, plan)): Ids<(SessionId, PlanId)>,
) -> Result<Json<PlanView>, Problem> {
    let record = find(&state, session, plan).await?;
    Ok(Json(PlanView::new(&record, content(&record)?)))
}

/// Delete a plan
///
/// Jobs keep what they need of it.
#[utoipa::path(delete, path = "/v1/sessions/{session}/plans/{plan}", tag = "bone",
    params(("session" = Uuid, Path), ("plan" = Uuid, Path)),
    responses((status = 204, description = "deleted")))]
pub(in crate::http) async fn delete(
    State(state): State<AppState>,
    Ids((session, plan)): Ids<(SessionId, PlanId)>,
) -> Result<StatusCode, Problem> {
    find(&state, session, plan).await?;
    state.service.store().delete_plan(session, plan).await?;
    Ok(StatusCode::NO_CONTENT)
}

pub(super) async fn find(state: &AppState, session: SessionId, id: PlanId) -> Result<PlanRecord, Problem> {
    SessionParts::load(state.service.store(), session).await?;
    match state.service.store().plan(session, id).await? {
        Some(record) => Ok(record),
        None if state.service.store().is_deleted(&id.to_string()).await? => {
            Err(Problem::new(FaultKind::Gone, format!("plan {id} was deleted")))
        }
        None => Err(Problem::new(FaultKind::NotFound, format!("the session has no plan {id}"))),
    }
}

pub(super) fn content(record: &PlanRecord) -> Result<PlanDocument, Problem> {
    serde_json::from_str(&record.document).map_err(|error| {
        tracing::error!(%error, "a stored plan cannot be read");
        Problem::new(FaultKind::Internal, "a stored plan cannot be read; the log says more")
    })
}
