use axum::Json;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;

use crate::http::dto::JobView;
use crate::http::extract::Answering;
use crate::http::{AppState, Problem};
use prosopon_contract::FaultKind;
use prosopon_jobs::{JobStatus, Order};
use prosopon_store::{JobKind, SessionId};

const RETRY_AFTER_S: &str = "1";

/// Stores a job without steps and options, and answers 202 with its location.
pub(super) async fn accept<T: Serialize>(
    state: &AppState,
    session: SessionId,
    kind: JobKind,
    request: &T,
    answering: Option<&Answering>,
) -> Result<Response, Problem> {
    accept_order(state, Order::new(session, kind, stored(request)?), answering).await
}

/// A request in its stored form.
pub(super) fn stored<T: Serialize>(request: &T) -> Result<String, Problem> {
    serde_json::to_string(request).map_err(|error| {
        tracing::error!(%error, "a request cannot be stored");
        Problem::new(FaultKind::Internal, "the request cannot be stored; see the log")
    })
}

/// Stores a job and answers 202 with its location.
pub(super) async fn accept_order(
    state: &AppState,
    order: Order,
    answering: Option<&Answering>,
) -> Result<Response, Problem> {
    Ok(accepted(&JobView::from(&store_order(state, order, answering).await?)))
}

/// Stores a job together with the answer for a repeated request.
pub(super) async fn store_order(
    state: &AppState,
    order: Order,
    answering: Option<&Answering>,
) -> Result<JobStatus, Problem> {
    let session = order.session;
    let answer = |job: &JobStatus| {
        let view = JobView::from(job);
        answering?.remember(StatusCode::ACCEPTED, &location(&view), Some(RETRY_AFTER_S), &view, session)
    };
    Ok(state.service.accept(order, &answer).await?)
}

/// The answer 202 with the job and its location.
pub(super) fn accepted(view: &JobView) -> Response {
    accepted_with(view, view)
}

/// The answer 202 with the job's location and a body that says more than the job.
pub(super) fn accepted_with<T: Serialize>(view: &JobView, body: &T) -> Response {
    let headers = [(header::LOCATION, location(view)), (header::RETRY_AFTER, RETRY_AFTER_S.to_owned())];
    (StatusCode::ACCEPTED, headers, Json(body)).into_response()
}

fn location(view: &JobView) -> String {
    format!("/v1/jobs/{}", view.id)
}
