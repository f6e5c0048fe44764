use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::response::Response;
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};

use super::report_page::report_page;
use super::results::{Movement, draw_error, draw_step};
use crate::http::extract::{Ids, Params};
use crate::http::result::{not_modified, tag_of, tagged};
use crate::http::{AppState, Problem};
use prosopon_contract::{Fault, FaultKind, ReportDocument};
use prosopon_store::{JobId, JobKind};

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
    let tag = tag_of(&[&text, if form == ReportForm::Html { "html" } else { "json" }]);
    if let Some(known) = not_modified(&headers, &tag) {
        return Ok(known);
    }
    if form == ReportForm::Json {
        return tagged(&headers, &tag, "application/json", text.into());
    }
    let mut pictures = Vec::new();
    if let Some(step) = state.service.store().steps(id).await?.last() {
        pictures.push(("Before and after", draw_step(&state.service, &job, step, Movement::Forward).await?));
        if step.error.is_some() {
            pictures.push(("Signed error", draw_error(&state.service, &job, step).await?));
        }
    }
    tagged(&headers, &tag, "text/html; charset=utf-8", report_page(&text, &pictures)?.into())
}
