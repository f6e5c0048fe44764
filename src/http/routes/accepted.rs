use axum::Json;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;

use crate::http::dto::JobView;
use crate::http::extract::Answering;
use crate::http::{AppState, Problem};
use crate::session::FaultKind;
use crate::store::{JobKind, SessionId};

const RETRY_AFTER_S: &str = "1";

/// Stores a job and answers 202 with where to look for it.
pub(super) async fn accept<T: Serialize>(
    state: &AppState,
    session: SessionId,
    kind: JobKind,
    steps: u32,
    request: &T,
    answering: Option<&Answering>,
) -> Result<Response, Problem> {
    let request = serde_json::to_string(request).map_err(|error| {
        tracing::error!(%error, "a request cannot be stored");
        Problem::new(FaultKind::Internal, "the request cannot be stored; the log says more")
    })?;
    let location = |id| format!("/v1/jobs/{id}");
    let job = state
        .service
        .accept(session, kind, steps, request, |job| {
            let view = JobView::new(job);
            answering?.remember(StatusCode::ACCEPTED, &location(job.id), Some(RETRY_AFTER_S), &view, session)
        })
        .await?;
    let headers = [(header::LOCATION, location(job.id)), (header::RETRY_AFTER, RETRY_AFTER_S.to_owned())];
    Ok((StatusCode::ACCEPTED, headers, Json(JobView::new(&job))).into_response())
}
