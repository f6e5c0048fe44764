use std::panic::AssertUnwindSafe;
use std::time::Duration;

use axum::extract::{Request, State};
use axum::http::{StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use futures::FutureExt;

use crate::http::Problem;
use crate::http::problem::PROBLEM_JSON;
use prosopon_contract::FaultKind;

/// Turns panics, time-outs and error answers of libraries into problem documents.
pub(in crate::http) async fn catch_errors(State(limit): State<Duration>, request: Request, next: Next) -> Response {
    let answer = AssertUnwindSafe(next.run(request)).catch_unwind();
    let response = match tokio::time::timeout(limit, answer).await {
        Ok(Ok(response)) => response,
        Ok(Err(_)) => {
            tracing::error!("a handler panicked");
            return Problem::new(FaultKind::Internal, "the request failed in the service; see the log").into_response();
        }
        Err(_) => {
            let detail = format!("the service had no answer within {} s; try again", limit.as_secs());
            return Problem::new(FaultKind::Timeout, detail).into_response();
        }
    };
    let status = response.status();
    let is_problem = response.headers().get(header::CONTENT_TYPE).is_some_and(|t| t == PROBLEM_JSON);
    if !(status.is_client_error() || status.is_server_error()) || is_problem {
        return response;
    }
    let reason = status.canonical_reason().unwrap_or("refused");
    let (kind, detail) = match status {
        StatusCode::NOT_FOUND => (FaultKind::NotFound, "there is nothing at this path"),
        StatusCode::METHOD_NOT_ALLOWED => {
            (FaultKind::MethodNotAllowed, "the Allow header names the methods of this path")
        }
        StatusCode::PAYLOAD_TOO_LARGE => (FaultKind::TooLarge, reason),
        StatusCode::REQUEST_TIMEOUT => (FaultKind::Timeout, reason),
        StatusCode::UNSUPPORTED_MEDIA_TYPE => (FaultKind::UnsupportedFormat, reason),
        status if status.is_client_error() => (FaultKind::MalformedRequest, reason),
        _ => (FaultKind::Internal, reason),
    };
    let allow = response.headers().get(header::ALLOW).cloned();
    let mut problem = Problem::new(kind, detail).into_response();
    if let Some(allow) = allow {
        problem.headers_mut().insert(header::ALLOW, allow);
    }
    problem
}
