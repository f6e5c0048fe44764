//! The HTTP API: routes, problems, documents.
//!
//! Invariants: handlers extract, convert, call one function of the domain and convert back, and compute nothing; every
//! error answer is a problem (RFC 9457); faults turn into statuses in `problem.rs` only; nothing of a patient is logged; no handler
//! runs for a sender who may not call it, and none sees another tenant's session or job.

pub mod auth;
pub mod dto;
mod extract;
mod middleware;
mod openapi;
mod problem;
mod result;
mod routes;
mod state;
mod surface_format;
mod upload;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::middleware::{from_fn, from_fn_with_state};
use utoipa_swagger_ui::SwaggerUi;

pub use extract::{JsonFault, strict_json, strict_value};
pub use openapi::{openapi, openapi_json};
pub use problem::{Problem, ProblemDocument, ProblemField};
pub use state::{AppState, HttpLimits};

use prosopon_session::FaultKind;

/// The whole service as a router.
pub fn app(state: AppState) -> Router {
    let (plain, uploads) = routes::all();
    let plain = plain.split_for_parts().0.layer(DefaultBodyLimit::max(state.limits.max_json_bytes));
    let uploads = uploads.split_for_parts().0.layer(DefaultBodyLimit::disable());
    let api = plain.merge(uploads).with_state(state.clone());
    with_bounds(api.merge(SwaggerUi::new("/docs").url("/openapi.json", openapi())), state)
}

/// The router of a process that only computes: health and metrics.
pub fn worker_app(state: AppState) -> Router {
    with_bounds(routes::health().split_for_parts().0.with_state(state.clone()), state)
}

fn with_bounds(routes: Router, state: AppState) -> Router {
    routes
        .fallback(unknown_path)
        .method_not_allowed_fallback(wrong_method)
        .layer(middleware::compression())
        .layer(from_fn(middleware::mark_compressed))
        .layer(from_fn_with_state(state.limits.answer, middleware::safety_net))
        .layer(from_fn_with_state(state.clone(), middleware::guard))
        .layer(middleware::cors(&state.origins))
        .layer(from_fn_with_state(state.clone(), middleware::check_host))
        .layer(from_fn_with_state(state.tls, middleware::security_headers))
        .layer(from_fn(middleware::envelope))
}

async fn unknown_path() -> Problem {
    Problem::new(FaultKind::NotFound, "there is nothing at this path; /openapi.json lists what there is")
}

async fn wrong_method() -> Problem {
    Problem::new(FaultKind::MethodNotAllowed, "the Allow header names the methods of this path")
}
