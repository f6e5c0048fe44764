use axum::Json;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::osteotomies::current_osteotomy;
use crate::http::dto::{PlanList, PlanView};
use crate::http::extract::{CreateBody, Ids};
use crate::http::{AppState, Problem};
use prosopon_contract::{CheckedPlan, CreatePlan, FaultKind, PlanDocument, Segments, from_json, stored_cuts, to_json};
use prosopon_geometry::Warning;
use prosopon_jobs::{make_plan, measure_plan};
use prosopon_session::SessionParts;
use prosopon_store::{OsteotomyId, PlanId, PlanRecord, SessionId, now_rfc3339};

/// Create a plan
///
/// Plans rigid paths of the bone segments; screw motions join the waypoints. With an osteotomy, the answer reports how far they
/// move; read the plan for overlaps and gaps of bone along the paths, which take a second to measure. A plan for an uploaded
/// tissue mesh has no report.
#[utoipa::path(post, path = "/v1/sessions/{session}/plans", operation_id = "createPlan", tag = "bone", params(("session" = Uuid, Path)),
    request_body = CreatePlan,
    responses((status = 201, description = "The plan.", body = PlanView, headers(("Location" = String)))))]
pub(in crate::http) async fn create(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    creating: CreateBody<CreatePlan>,
) -> Result<Response, Problem> {
    let (request, answering) = creating.split();
    let parts = SessionParts::load(state.service.store(), session).await?;
    let (record, content) = make(&state, &parts, session, request).await?;
    let view = PlanView::new(&record, content);
    let location = format!("/v1/sessions/{session}/plans/{}", record.id);
    let answer = answering.remember(StatusCode::CREATED, &location, None, &view, session);
    state.service.store().insert_plan(&record, answer.as_ref()).await?;
    Ok((StatusCode::CREATED, [(header::LOCATION, location)], Json(view)).into_response())
}

/// A new plan and its document; the caller stores its row.
pub(super) async fn make(
    state: &AppState,
    parts: &SessionParts,
    session: SessionId,
    request: CreatePlan,
) -> Result<(PlanRecord, PlanDocument), Problem> {
    let osteotomy = request.osteotomy.map(OsteotomyId::from);
    let content = match osteotomy {
        Some(osteotomy) => {
            let (_, bone) = current_osteotomy(state, parts, session, osteotomy, "/osteotomy").await?;
            let CheckedPlan { label, plan, notes } =
                request.check(&Segments::from(&bone).with_landmarks(parts.landmarks()?))?;
            make_plan(&state.service, parts, stored_cuts(&bone.cuts)?, plan, label).await?.noted(notes)
        }
        None => {
            let tissue = parts.require_tissue("name an osteotomy, or PUT a tissue mesh first")?;
            let CheckedPlan { label, plan, notes } =
                request.check(&Segments::of_tissue(&tissue, &parts.bone_keys()).with_landmarks(parts.landmarks()?))?;
            PlanDocument::new(label, &plan).noted(notes)
        }
    };
    let record = PlanRecord {
        id: PlanId::new(),
        session,
        osteotomy,
        document: to_json("the plan", &content)?,
        created_at: now_rfc3339(),
    };
    Ok((record, content))
}

/// List plans
///
/// Returns all plans of the session, oldest first.
#[utoipa::path(get, path = "/v1/sessions/{session}/plans", operation_id = "listPlans", tag = "bone", params(("session" = Uuid, Path)),
    responses((status = 200, description = "All plans.", body = PlanList)))]
pub(in crate::http) async fn list(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
) -> Result<Json<PlanList>, Problem> {
    SessionParts::load(state.service.store(), session).await?;
    let records = state.service.store().plans(session).await?;
    let plans = records.iter().map(|r| Ok(PlanView::new(r, content(r)?))).collect::<Result<_, Problem>>()?;
    Ok(Json(PlanList { plans }))
}

/// Read a plan
///
/// Returns its paths and the report on them. The first reading measures overlaps and gaps of bone; `measured` is false where
/// bone or settings have changed since the bone was cut, with a warning.
#[utoipa::path(get, path = "/v1/sessions/{session}/plans/{plan}", operation_id = "getPlan", tag = "bone",
    params(("session" = Uuid, Path), ("plan" = Uuid, Path)),
    responses((status = 200, description = "The plan.", body = PlanView)))]
pub(in crate::http) async fn get(
    State(state): State<AppState>,
    Ids((session, plan)): Ids<(SessionId, PlanId)>,
) -> Result<Json<PlanView>, Problem> {
    let record = find(&state, session, plan).await?;
    let content = measured(&state, &record).await?;
    Ok(Json(PlanView::new(&record, content)))
}

/// Delete a plan
///
/// Deletes the plan. Jobs keep their own copies.
#[utoipa::path(delete, path = "/v1/sessions/{session}/plans/{plan}", operation_id = "deletePlan", tag = "bone",
    params(("session" = Uuid, Path), ("plan" = Uuid, Path)),
    responses((status = 204, description = "Deleted.")))]
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

/// The content of a plan with overlaps and gaps, which are stored once they are measured.
///
/// They stay unmeasured when bone or settings have changed since the bone was cut.
pub(super) async fn measured(state: &AppState, record: &PlanRecord) -> Result<PlanDocument, Problem> {
    let content = content(record)?;
    let (false, Some(osteotomy)) = (content.measured, record.osteotomy) else { return Ok(content) };
    let parts = SessionParts::load(state.service.store(), record.session).await?;
    let bone = match current_osteotomy(state, &parts, record.session, osteotomy, "/osteotomy").await {
        Ok((_, bone)) => bone,
        Err(Problem(fault)) if matches!(fault.kind, FaultKind::Stale | FaultKind::MissingInput) => {
            let warning =
                Warning::check("plan-not-measured", format!("overlaps of bone are not known: {}", fault.detail));
            return Ok(content.warned(warning.act("Cut the bone again, and plan on the new osteotomy.")));
        }
        Err(problem) => return Err(problem),
    };
    let content = measure_plan(&state.service, &parts, stored_cuts(&bone.cuts)?, content).await?;
    let stored = state.service.store().set_plan(record.session, record.id, &to_json("the plan", &content)?).await;
    if let Err(error) = stored {
        // On a full disk plans can be read all the same.
        tracing::warn!(%error, "the measured plan is not stored");
    }
    Ok(content)
}

pub(super) fn content(record: &PlanRecord) -> Result<PlanDocument, Problem> {
    Ok(from_json("the plan", &record.document)?)
}
