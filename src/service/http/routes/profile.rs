use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;

use crate::http::extract::Ids;
use crate::http::result::{not_modified, tag_of, tagged};
use crate::http::{AppState, Problem};
use prosopon_contract::{Fault, FaultKind, ReportDocument, from_json};
use prosopon_session::profile_picture;
use prosopon_store::{JobId, JobKind};

/// Draw the profile of a solve
///
/// Returns an SVG picture of the skin's line in the midsagittal plane before and after, with the named points of skin, bone and
/// teeth. The face looks to the left; one millimetre has four pixels along both axes. The report has the same line as numbers
/// (`clinical.profile`).
#[utoipa::path(get, path = "/v1/jobs/{job}/profile.svg", operation_id = "getProfile", tag = "results", params(("job" = Uuid, Path)),
    responses((status = 200, description = "The picture.", body = Vec<u8>, content_type = "image/svg+xml"),
        (status = 304, description = "Not modified.")))]
pub(in crate::http) async fn profile(
    State(state): State<AppState>,
    Ids(id): Ids<JobId>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let job = state.service.job(id).await?;
    if job.kind != JobKind::Solve {
        let detail = format!("a job of kind {} has no profile; name a solve", job.kind.as_str());
        return Err(Problem::new(FaultKind::NotFound, detail));
    }
    let Some(text) = job.report else {
        let detail = format!("the profile is not available; the status of the job is {}", job.state);
        return Err(Fault::new(FaultKind::NotReady, detail).with("job_status", job.state.as_str()).into());
    };
    let tag = tag_of(&[&text, "profile.svg"]);
    if let Some(known) = not_modified(&headers, &tag) {
        return Ok(known);
    }
    let report: ReportDocument = from_json("the report", &text)?;
    let Some(clinical) = report.clinical else {
        let detail = if report.findings.warnings.iter().any(|w| w.code == "points-not-measured") {
            "the job has no profile: named points could not be measured; its warning `points-not-measured` says why"
        } else {
            "the job has no profile: it solved an uploaded tissue mesh, or an earlier version solved it"
        };
        return Err(Problem::new(FaultKind::NotFound, detail));
    };
    let svg = state.service.compute(move |_, _| Ok(profile_picture(&clinical)?)).await?;
    tagged(&headers, &tag, "image/svg+xml", svg.into())
}
