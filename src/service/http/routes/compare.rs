use std::time::Duration;

use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};

use super::accepted::{accepted, store_order, stored};
use crate::http::auth::Principal;
use crate::http::dto::{CompareView, JobView, finite};
use crate::http::extract::{Ids, Params, RepeatableBody, mark_replayed};
use crate::http::result::{tag_of, tagged};
use crate::http::surface_format::SurfaceOutput;
use crate::http::{AppState, Problem};
use prosopon_contract::{CompareRequest, Fault, FaultKind, SurfaceSource};
use prosopon_formats::export::SurfaceView;
use prosopon_jobs::{CompareTask, Compared, NamedSurface, Order, named_surface, read_comparison};
use prosopon_session::error_sheet;
use prosopon_store::{AnswerRecord, JobId, JobKind, JobRecord, JobState, SessionId};

/// Default wait: a comparison that ends within it is answered directly, a longer one as a job.
const PATIENCE: Duration = Duration::from_millis(900);
/// Longest wait that a client can ask for, s.
const MAX_WAIT_S: u64 = 60;

/// Format of a comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::http) enum CompareForm {
    /// Statistics of the error as JSON.
    Json,
    /// A PNG sheet with the error map from all sides.
    Png,
    /// The prediction with `error_mm` as binary glTF 2.0.
    Glb,
    /// The prediction with `error_mm` as binary PLY.
    Ply,
    /// The prediction with `error_mm` as VTK polygons.
    Vtp,
}

/// Format of the answer to a comparison.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct CompareQuery {
    /// Format of the answer; `json` when absent.
    #[param(inline)]
    format: Option<CompareForm>,
}

/// Format of a stored comparison.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct ComparisonQuery {
    /// Format of the answer; `json` when absent.
    #[param(inline)]
    format: Option<CompareForm>,
    /// Whether the JSON includes the value of every vertex; false when absent.
    values: Option<bool>,
}

/// Compare two stored surfaces
///
/// Returns the signed error of the prediction against the reference, after rigid registration on request: statistics, a
/// picture, or the prediction with the error of every vertex, in the prediction's own coordinates.
///
/// The comparison is a `compare` job of the prediction's session. If it ends within about one second, the answer is 200 with
/// the result. Otherwise it is 202 with the job, whose link `comparison` leads to the result. `Prefer: wait=N` waits up to N
/// seconds (at most 60), `Prefer: respond-async` does not wait. A repeated `Idempotency-Key` returns the current state of the
/// same job.
#[utoipa::path(post, path = "/v1/compare", operation_id = "compare", tag = "results", request_body = CompareRequest,
    params(CompareQuery, ("Prefer" = Option<String>, Header)),
    responses((status = 200, description = "The error map.", headers(("Content-Location" = String)), content(
        (CompareView = "application/json"), (Vec<u8> = "image/png"), (Vec<u8> = "model/gltf-binary"),
        (Vec<u8> = "application/ply"), (Vec<u8> = "application/vnd.vtk.vtp"))),
        (status = 202, description = "The compare job.", body = JobView, headers(("Location" = String), ("Retry-After" = u32)))))]
pub(in crate::http) async fn compare(
    State(state): State<AppState>,
    principal: Principal,
    Params(query): Params<CompareQuery>,
    headers: HeaderMap,
    RepeatableBody { creating, earlier }: RepeatableBody<CompareRequest>,
) -> Result<Response, Problem> {
    let (request, answering) = creating.split();
    let values = request.values;
    let job = match &earlier {
        Some(answer) => named_job(answer)?,
        None => {
            let (record, order) = order(&state, &principal, &request).await?;
            let order = Order { request: stored(&record)?, ..order };
            store_order(&state, order, Some(&answering)).await?.record.id
        }
    };
    let mut response = answer(&state, job, patience(&headers), query.format, values).await?;
    if earlier.is_some() {
        mark_replayed(response.headers_mut());
    }
    Ok(response)
}

/// The result of a comparison that ends within `patience`, else the location of its job.
async fn answer(
    state: &AppState,
    job: JobId,
    patience: Duration,
    form: Option<CompareForm>,
    values: bool,
) -> Result<Response, Problem> {
    let status = state.service.wait(job, patience).await?;
    match status.record.state {
        JobState::Succeeded => {
            let form = form.unwrap_or(CompareForm::Json);
            let mut response = send(state, &status.record, form, values, &HeaderMap::new()).await?;
            if let Ok(location) = HeaderValue::from_str(&format!("/v1/jobs/{job}/comparison")) {
                response.headers_mut().insert(header::CONTENT_LOCATION, location);
            }
            Ok(response)
        }
        JobState::Failed => Err(failure(&status.record)),
        JobState::Accepted | JobState::Running | JobState::Cancelled | JobState::Interrupted => {
            Ok(accepted(&JobView::from(&status)))
        }
    }
}

/// The job that a stored earlier answer names.
fn named_job(answer: &AnswerRecord) -> Result<JobId, Problem> {
    let id = answer.location.as_deref().and_then(|location| location.rsplit('/').next()?.parse().ok());
    id.ok_or_else(|| {
        tracing::error!("a stored answer to a comparison names no job");
        Problem::new(FaultKind::Internal, "a stored answer cannot be read; see the log")
    })
}

/// Read the result of a comparison
///
/// Returns the result in the formats of `POST /v1/compare`.
#[utoipa::path(get, path = "/v1/jobs/{job}/comparison", operation_id = "getComparison", tag = "results", params(("job" = Uuid, Path), ComparisonQuery),
    responses((status = 200, description = "The error map.", content(
        (CompareView = "application/json"), (Vec<u8> = "image/png"), (Vec<u8> = "model/gltf-binary"),
        (Vec<u8> = "application/ply"), (Vec<u8> = "application/vnd.vtk.vtp"))),
        (status = 304, description = "Not modified.")))]
pub(in crate::http) async fn comparison(
    State(state): State<AppState>,
    Ids(job): Ids<JobId>,
    Params(query): Params<ComparisonQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let job = state.service.job(job).await?;
    if job.kind == JobKind::Compare && job.state == JobState::Failed {
        return Err(failure(&job));
    }
    send(&state, &job, query.format.unwrap_or(CompareForm::Json), query.values.unwrap_or(false), &headers).await
}

/// Builds the record and the order of a comparison.
///
/// Fails unless both surfaces exist and belong to the sender.
async fn order(
    state: &AppState,
    principal: &Principal,
    request: &CompareRequest,
) -> Result<(CompareTask, Order), Problem> {
    let checked = request.checked()?;
    let predicted = own_surface(state, principal, checked.prediction).await?;
    let compared_with = own_surface(state, principal, checked.reference).await?;
    // Whether values are sent does not change the result.
    let request = CompareRequest { values: false, ..request.clone() };
    let record = CompareTask { request, keys: [predicted.key, compared_with.key] };
    let other_session = Some(compared_with.session).filter(|other| *other != predicted.session);
    Ok((record, Order { other_session, ..Order::new(predicted.session, JobKind::Compare, String::new()) }))
}

/// The surface that the body names. A surface of another tenant is reported as not found.
async fn own_surface(state: &AppState, principal: &Principal, source: SurfaceSource) -> Result<NamedSurface, Problem> {
    let own = |session: SessionId| async move {
        match state.service.store().owner(&session.to_string()).await? {
            Some(owner) if owner.tenant != principal.tenant => {
                Err(Problem::new(FaultKind::NotFound, format!("there is no session {session}")))
            }
            Some(owner) if owner.deleted => {
                Err(Problem::new(FaultKind::Gone, format!("session {session} was deleted")))
            }
            _ => Ok(()),
        }
    };
    match source {
        SurfaceSource::Step(job, _) => _ = state.service.job_of(&principal.tenant, job).await?,
        SurfaceSource::Skin(session) | SurfaceSource::Skull(session) | SurfaceSource::Target(session) => {
            own(session).await?;
        }
    }
    Ok(named_surface(&state.service, source).await?)
}

/// How long the client is willing to wait for a comparison, from its `Prefer` header (RFC 7240).
fn patience(headers: &HeaderMap) -> Duration {
    let mut patience = PATIENCE;
    for preference in headers.get_all("prefer").iter().filter_map(|p| p.to_str().ok()).flat_map(|p| p.split([',', ';']))
    {
        let preference = preference.trim();
        if preference.eq_ignore_ascii_case("respond-async") {
            return Duration::ZERO;
        }
        if let Some(seconds) = preference.strip_prefix("wait=").and_then(|s| s.parse::<u64>().ok()) {
            patience = Duration::from_secs(seconds.min(MAX_WAIT_S));
        }
    }
    patience
}

/// The problem that a failed job stored.
fn failure(job: &JobRecord) -> Problem {
    let fault = job.fault.as_deref().and_then(|f| serde_json::from_str::<Fault>(f).ok());
    fault.map_or_else(|| Problem::new(FaultKind::Internal, "the comparison failed; see the log"), Problem::from)
}

async fn send(
    state: &AppState,
    job: &JobRecord,
    form: CompareForm,
    values: bool,
    headers: &HeaderMap,
) -> Result<Response, Problem> {
    let compared = read_comparison(&state.service, job).await?;
    let tag = tag_of(&[&job.id.to_string(), &format!("{form:?}"), &values.to_string()]);
    let format = match form {
        CompareForm::Json => {
            let text = serde_json::to_vec(&view(compared, values))
                .map_err(|_| Problem::new(FaultKind::Internal, "the comparison cannot be written"))?;
            return tagged(headers, &tag, "application/json", text.into());
        }
        CompareForm::Png => {
            let sheet = move |_: &dyn prosopon_session::Engine, _: &prosopon_geometry::control::Control| {
                Ok(error_sheet(&compared.mesh, &compared.error_mm, &compared.document))
            };
            return tagged(headers, &tag, "image/png", state.service.compute(sheet).await?.into());
        }
        CompareForm::Glb => SurfaceOutput::Glb,
        CompareForm::Ply => SurfaceOutput::Ply,
        CompareForm::Vtp => SurfaceOutput::Vtp,
    };
    let bytes = state.service.compute(move |_, _| Ok(write(&compared, format))).await?;
    tagged(headers, &tag, format.media_type(), bytes.into())
}

fn view(compared: Compared, values: bool) -> CompareView {
    let Compared { document, error_mm, correspondence_mm, .. } = compared;
    CompareView {
        content: document,
        values_mm: values.then(|| finite(error_mm)),
        correspondence_mm: correspondence_mm.filter(|_| values).map(finite),
    }
}

fn write(compared: &Compared, format: SurfaceOutput) -> Vec<u8> {
    let mut scalars = vec![("error_mm", compared.error_mm.as_slice())];
    scalars.extend(compared.correspondence_mm.as_deref().map(|c| ("correspondence_mm", c)));
    format.write(&SurfaceView { mesh: &compared.mesh, scalars: &scalars, colours: None })
}
