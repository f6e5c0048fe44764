use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};

use super::report_page::report_page;
use super::report_pictures::pictures;
use crate::http::extract::{Ids, Params};
use crate::http::result::{not_modified, tag_of, tagged};
use crate::http::{AppState, Problem};
use prosopon_contract::{Fault, FaultKind, ReportDocument, from_json};
use prosopon_jobs::Service;
use prosopon_store::{JobId, JobKind, JobRecord};

/// Version of the page's layout: a browser that has an older one loads it again.
const PAGE_LAYOUT: &str = "3";
/// Content policy of the page: its own styles, pictures inside it, and nothing else.
const PAGE_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'; \
    base-uri 'none'; form-action 'none'";

/// Format of a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::http) enum ReportForm {
    /// A JSON document.
    Json,
    /// A self-contained HTML page with pictures.
    Html,
}

/// Format of the report to send.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct ReportQuery {
    /// Format of the answer. When absent, the `Accept` header chooses, else JSON.
    #[param(inline)]
    format: Option<ReportForm>,
}

/// Read the report of a solve
///
/// Returns inputs, plan, parameters, version, residuals, times by phase and warnings, as JSON or as a self-contained page with
/// pictures.
#[utoipa::path(get, path = "/v1/jobs/{job}/report", operation_id = "getReport", tag = "results", params(("job" = Uuid, Path), ReportQuery),
    responses((status = 200, description = "The report.", content(
        (ReportDocument = "application/json"), (String = "text/html"))), (status = 304, description = "Not modified.")))]
pub(in crate::http) async fn report(
    State(state): State<AppState>,
    Ids(id): Ids<JobId>,
    Params(query): Params<ReportQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let job = state.service.job(id).await?;
    if job.kind != JobKind::Solve {
        let detail = format!("a job of kind {} has no report; name a solve", job.kind.as_str());
        return Err(Problem::new(FaultKind::NotFound, detail));
    }
    let Some(text) = job.report.clone() else {
        let detail = format!("the report is not available; the status of the job is {}", job.state);
        return Err(Fault::new(FaultKind::NotReady, detail).with("job_status", job.state.as_str()).into());
    };
    let accepts_html =
        headers.get(header::ACCEPT).and_then(|a| a.to_str().ok()).is_some_and(|a| a.contains("text/html"));
    let form = query.format.unwrap_or(if accepts_html { ReportForm::Html } else { ReportForm::Json });
    if form == ReportForm::Json {
        let tag = tag_of(&[&text, "json"]);
        return tagged(&headers, &tag, "application/json", text.into());
    }
    page(&state.service, &job, &text, &headers).await
}

/// The report as a page. Its tag includes the session's label, which is stored apart from the report.
async fn page(service: &Service, job: &JobRecord, text: &str, headers: &HeaderMap) -> Result<Response, Problem> {
    let report: ReportDocument = from_json("the report", text)?;
    let label = service.store().session(job.session).await?.and_then(|session| session.label);
    let tag = tag_of(&[text, "html", PAGE_LAYOUT, &format!("{label:?}")]);
    if let Some(known) = not_modified(headers, &tag) {
        return Ok(known);
    }
    let rows = match service.store().steps(job.id).await?.last() {
        Some(step) => pictures(service, job, step).await?,
        None => Vec::new(),
    };
    let page = report_page(&report, label.as_deref(), &rows)?;
    let mut response = tagged(headers, &tag, "text/html; charset=utf-8", page.into())?;
    response.headers_mut().insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(PAGE_POLICY));
    Ok(response)
}
