use std::time::Duration;

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::Response;
use serde::Deserialize;
use utoipa::IntoParams;
use uuid::Uuid;

use super::accepted::{accept_order, stored};
use super::budget::keep_budget;
use super::mesh_choice::mesh_of;
use super::osteotomies::current_osteotomy;
use super::plans;
use super::warm_start::with_warm_start;
use crate::http::auth::Principal;
use crate::http::dto::{JobList, JobView, statuses};
use crate::http::extract::{Answering, CreateBody, Ids, Params, page_length};
use crate::http::{AppState, Problem};
use prosopon_contract::{
    CutDocument, Fault, FaultKind, OsteotomyDocument, PlanChoice, PlanDocument, SessionSettings, SolveRequest,
    SupersedeChoice, TissueDocument, from_json, short_number,
};
use prosopon_jobs::{Given, Order, SceneTask, SolveTask};
use prosopon_planning::simulate::{HEAD_LOCKING, READY_MESH_LOCKING};
use prosopon_session::SessionParts;
use prosopon_store::{JobFilter, JobId, JobKind, JobState, PartKind, PlanRecord, SessionId, SupersedeScope};

/// Longest long poll, s.
const MAX_WAIT_S: f64 = 60.0;

/// Filter and page of a list of jobs.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct Page {
    /// Id of a session: lists only its jobs.
    session: Option<Uuid>,
    /// Status: lists only jobs with this status.
    #[param(schema_with = statuses)]
    status: Option<String>,
    /// Id of a job: lists only jobs created before it.
    before: Option<Uuid>,
    /// Largest number of jobs on the page, 1 to 100; 20 when absent.
    #[param(minimum = 1, maximum = 100)]
    limit: Option<u32>,
}

/// Options for waiting for a job.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct Wait {
    /// Longest wait for the job's end, s, 0 to 60; 0 when absent.
    ///
    /// The answer comes when the job ends or after this time.
    wait_s: Option<f64>,
}

/// Start a solve
///
/// Starts a `solve` job that moves the bone along a plan and streams its steps. The session needs distance fields, or an
/// uploaded tissue mesh. The job builds a tissue mesh if none matches. A request that equals that of a waiting or running job of the
/// session returns that job.
#[utoipa::path(post, path = "/v1/sessions/{session}/jobs", operation_id = "solve", tag = "jobs", params(("session" = Uuid, Path)),
    request_body = SolveRequest,
    responses((status = 202, description = "The job.", body = JobView, headers(("Location" = String), ("Retry-After" = u32)))))]
pub(in crate::http) async fn create(
    State(state): State<AppState>,
    principal: Principal,
    Ids(session): Ids<SessionId>,
    creating: CreateBody<SolveRequest>,
) -> Result<Response, Problem> {
    let (request, answering) = creating.split();
    let parts = SessionParts::load(state.service.store(), session).await?;
    check_painted(&request, &parts)?;
    let defaults = session_settings(&state, session).await?;
    let ready = parts.tissue()?;
    let locking = if ready.is_some() {
        request.check_uploaded_mesh()?;
        READY_MESH_LOCKING
    } else {
        HEAD_LOCKING
    };
    let given = Given { mesh: request.mesh.is_some(), locking: request.locking.is_some() };
    let mut request = request.resolved(&defaults, state.service.settings().max_wall, locking)?;
    if ready.is_none() {
        parts.require_field()?;
    }
    if request.supersede == SupersedeChoice::Plan && request.plan.id().is_none() {
        let detail = "names the same plan, which no other solve has when the request brings a new one; use `session`";
        return Err(Fault::new(FaultKind::InvalidRequest, detail).at("/supersede").into());
    }
    let chosen = ChosenPlan::of(&state, &parts, session, request.plan).await?;
    request.plan = PlanChoice::Stored(chosen.record.id.uuid());
    let (max_wall_s, mesh_job) = (request.max_wall_s, request.mesh);
    let (steps, supersede) = (request.steps(), scope_of(request.supersede));
    let subject = Some(chosen.record.id.to_string());
    let order = |content: String| Order {
        steps,
        subject: subject.clone(),
        supersede,
        max_wall_s,
        ..Order::new(session, JobKind::Solve, content)
    };
    if let Some(ready) = ready {
        let scene = scene(&state, &parts, session, (&request, &chosen.record), ready).await?;
        return chosen.accept(&state, order(stored(&scene)?), &answering).await;
    }
    let plan = &chosen.record;
    let Some(osteotomy) = plan.osteotomy else {
        // The tissue mesh that the plan was made for has been removed.
        return Err(parts.require_tissue("the plan's tissue mesh was removed: PUT it again").err().map_or_else(
            || Problem::new(FaultKind::Internal, "the tissue mesh was just uploaded; send the request again"),
            Problem::from,
        ));
    };
    let (osteotomy, bone) = current_osteotomy(&state, &parts, session, osteotomy, "/plan").await?;
    let mut mesh = mesh_of(&state, &parts, session, osteotomy.id, &bone.cuts, mesh_job).await?;
    let content = plans::content(plan)?;
    let budget = keep_budget(&state.service, &parts, &mut request, &mut mesh, &content, given)?;
    let reference_job = request.reference_job.map(JobId::from);
    if let Some(id) = reference_job {
        check_reference(&state, &principal, id, plan, &bone.cuts).await?;
    }
    let solve = SolveTask {
        request: lasting(&request),
        osteotomy_id: osteotomy.id,
        plan: content,
        segment_names: bone.segment_names(),
        cuts: bone.cuts,
        cut_warnings: bone.findings.iter().cloned().collect(),
        cut_s: osteotomy.wall_s,
        mesh_key: parts.mesh_key(&mesh.settings, mesh.cuts.as_deref())?,
        mesh,
        budget,
        given,
        target: parts.get(PartKind::Target).map(|target| target.key.clone()),
        warm_start: None,
    };
    let solve = match request.warm_start {
        Some(id) => with_warm_start(&state, &principal, session, id.into(), solve).await?,
        None => solve,
    };
    chosen.accept(&state, order(stored(&solve)?), &answering).await
}

/// The plan of a solve.
struct ChosenPlan {
    record: PlanRecord,
    /// Whether the request brought the plan and the session has no equal one; then it is stored with the job.
    is_new: bool,
}

impl ChosenPlan {
    async fn of(state: &AppState, parts: &SessionParts, session: SessionId, plan: PlanChoice) -> Result<Self, Problem> {
        match plan {
            PlanChoice::Stored(id) => {
                let found = plans::find(state, session, id.into()).await;
                Ok(Self { record: found.map_err(|p| as_invalid_request(p, "/plan"))?, is_new: false })
            }
            PlanChoice::New(request) => {
                let made = plans::make(state, parts, session, *request).await;
                let (record, made) = made.map_err(|Problem(fault)| Problem(fault.below("/plan")))?;
                let known = state.service.store().plans(session).await?;
                let is_made = |plan: &PlanDocument| plan.paths == made.paths && plan.label == made.label;
                for stored in known.into_iter().filter(|stored| stored.osteotomy == record.osteotomy) {
                    if is_made(&plans::content(&stored)?) {
                        return Ok(Self { record: stored, is_new: false });
                    }
                }
                Ok(Self { record, is_new: true })
            }
        }
    }

    /// Stores a new plan and queues the job; the plan goes again where the job is refused.
    async fn accept(self, state: &AppState, order: Order, answering: &Answering) -> Result<Response, Problem> {
        let (store, plan) = (state.service.store(), &self.record);
        if self.is_new {
            store.insert_plan(plan, None).await?;
        }
        let answer = accept_order(state, order, Some(answering)).await;
        if answer.is_err() && self.is_new {
            store.delete_plan(plan.session, plan.id).await?;
        }
        answer
    }
}

fn scope_of(choice: SupersedeChoice) -> Option<SupersedeScope> {
    match choice {
        SupersedeChoice::Nothing => None,
        SupersedeChoice::Plan => Some(SupersedeScope::Subject),
        SupersedeChoice::Session => Some(SupersedeScope::Session),
    }
}

/// Painted classes must be as many as the skull has vertices now.
fn check_painted(request: &SolveRequest, parts: &SessionParts) -> Result<(), Problem> {
    match (&request.attachment, parts.skull_vertices()?) {
        (Some(attachment), Some(vertices)) => Ok(attachment.check_skull(vertices)?),
        _ => Ok(()),
    }
}

/// Default settings of a session's jobs.
pub(super) async fn session_settings(state: &AppState, session: SessionId) -> Result<SessionSettings, Problem> {
    let settings = state.service.store().session(session).await?.map(|s| s.settings).unwrap_or_default();
    match settings.as_str() {
        "" => Ok(SessionSettings::default()),
        stored => Ok(from_json("the document of the session's settings", stored)?),
    }
}

/// The part of a request that determines the result: jobs with equal parts are one job.
fn lasting(request: &SolveRequest) -> SolveRequest {
    SolveRequest { supersede: SupersedeChoice::Nothing, max_wall_s: None, mesh: None, ..request.clone() }
}

/// The request for a solve on the session's uploaded tissue mesh.
async fn scene(
    state: &AppState,
    parts: &SessionParts,
    session: SessionId,
    (request, plan): (&SolveRequest, &PlanRecord),
    ready: TissueDocument,
) -> Result<SceneTask, Problem> {
    let bone = match plan.osteotomy {
        Some(osteotomy) => Some(current_osteotomy(state, parts, session, osteotomy, "/plan").await?.1),
        None => None,
    };
    let field_key = if bone.is_some() { parts.field_key()? } else { String::new() };
    Ok(SceneTask {
        ready,
        request: SolveRequest { leave_out_below_mm: Some(0.0), ..lasting(request) },
        plan: plans::measured(state, plan).await?,
        osteotomy_id: plan.osteotomy,
        field_key,
        cut_warnings: bone.iter().flat_map(|bone| bone.findings.iter().cloned()).collect(),
        segment_names: bone.as_ref().map(OsteotomyDocument::segment_names).unwrap_or_default(),
        cuts: bone.map(|bone| bone.cuts),
        bones: parts.bone_keys(),
        field_settings: parts.field_settings()?,
    })
}

/// Turns a fault about an id in the body into invalid-request: the value is wrong, not the path.
fn as_invalid_request(Problem(fault): Problem, pointer: &str) -> Problem {
    Fault { kind: FaultKind::InvalidRequest, ..fault.at(pointer) }.into()
}

/// Checks that the reference job is a succeeded solve with the same cuts and paths.
async fn check_reference(
    state: &AppState,
    principal: &Principal,
    id: JobId,
    plan: &PlanRecord,
    cuts: &[CutDocument],
) -> Result<(), Problem> {
    let job = state
        .service
        .job_of(&principal.tenant, id)
        .await
        .map_err(|f| as_invalid_request(f.into(), "/reference_job"))?;
    let wrong = |kind, detail: String| Problem(Fault::new(kind, detail).at("/reference_job"));
    if job.kind != JobKind::Solve || job.state != JobState::Succeeded {
        let detail = format!("job {id} is not a succeeded solve but a {} that is {}", job.kind.as_str(), job.state);
        return Err(wrong(FaultKind::InvalidRequest, detail));
    }
    let solved = SolveTask::of(&job)
        .map_err(|why| wrong(FaultKind::InvalidRequest, format!("job {id} {why}; name another one")))?;
    if solved.cuts != cuts || solved.plan.paths != plans::content(plan)?.paths {
        let followed = solved.request.plan.id().map_or_else(|| "another plan".to_owned(), |id| format!("plan {id}"));
        let detail = format!("job {id} followed {followed}, whose cuts or paths differ from plan {}", plan.id);
        return Err(wrong(FaultKind::WrongState, detail));
    }
    Ok(())
}

/// List jobs
///
/// Returns one page of jobs, newest first.
#[utoipa::path(get, path = "/v1/jobs", operation_id = "listJobs", tag = "jobs", params(Page),
    responses((status = 200, description = "One page.", body = JobList)))]
pub(in crate::http) async fn list(
    State(state): State<AppState>,
    principal: Principal,
    Params(page): Params<Page>,
) -> Result<Json<JobList>, Problem> {
    let limit = page_length(page.limit)?;
    let wanted = page.status.as_deref().map(str::parse::<JobState>).transpose();
    let filter = JobFilter {
        tenant: Some(principal.tenant),
        session: page.session.map(SessionId::from),
        kind: None,
        state: wanted.map_err(|detail| Fault::new(FaultKind::MalformedRequest, detail).at("status"))?,
        before: page.before.map(JobId::from),
        limit,
    };
    let records = state.service.store().jobs(&filter).await?;
    let next = records.last().filter(|_| records.len() == limit as usize).map(|last| next_page(&page, last.id, limit));
    let jobs = state.service.statuses_of(records).await?.iter().map(JobView::from).collect();
    Ok(Json(JobList { jobs, next }))
}

fn next_page(page: &Page, last: JobId, limit: u32) -> String {
    let session = page.session.map(|s| format!("&session={s}")).unwrap_or_default();
    let status = page.status.as_ref().map(|s| format!("&status={s}")).unwrap_or_default();
    format!("/v1/jobs?before={last}&limit={limit}{session}{status}")
}

/// Read a job
///
/// Returns status, phase, progress and links to the results so far. With `wait_s` the request is a long poll.
#[utoipa::path(get, path = "/v1/jobs/{job}", operation_id = "getJob", tag = "jobs", params(("job" = Uuid, Path), Wait),
    responses((status = 200, description = "State of the job.", body = JobView)))]
pub(in crate::http) async fn get(
    State(state): State<AppState>,
    Ids(job): Ids<JobId>,
    Params(wait): Params<Wait>,
) -> Result<Json<JobView>, Problem> {
    let wait_s = wait.wait_s.unwrap_or(0.0);
    if !(0.0..=MAX_WAIT_S).contains(&wait_s) {
        let detail = format!("is {}, allowed is 0 to {MAX_WAIT_S}", short_number(wait_s));
        return Err(Fault::new(FaultKind::MalformedRequest, detail).at("wait_s").into());
    }
    Ok(Json(JobView::from(&state.service.wait(job, Duration::from_secs_f64(wait_s)).await?)))
}

/// Cancel a job
///
/// A waiting job ends at once, a running one within a second. The request is stored before the answer, so the job cannot succeed
/// afterwards. It ends for every client that has it: equal requests of a session share one job while it waits or runs, also when
/// their idempotency keys differ.
#[utoipa::path(post, path = "/v1/jobs/{job}/cancel", operation_id = "cancelJob", tag = "jobs", params(("job" = Uuid, Path)),
    responses((status = 202, description = "The job, which will stop.", body = JobView)))]
pub(in crate::http) async fn cancel(
    State(state): State<AppState>,
    Ids(job): Ids<JobId>,
) -> Result<(StatusCode, Json<JobView>), Problem> {
    Ok((StatusCode::ACCEPTED, Json(JobView::from(&state.service.cancel(job).await?))))
}
