//! The HTTP API: routes, problems and documents.
//!
//! Invariants:
//!
//! - A handler extracts, converts, calls one domain function and converts back. It computes nothing.
//! - Every error answer is a problem document (RFC 9457). Only `problem.rs` maps faults to statuses.
//! - The log contains no patient data.
//! - A handler runs only for a sender with the required scope, and only for sessions and jobs of the sender's tenant.

pub mod auth;
pub mod dto;
mod extract;
mod form;
mod middleware;
mod openapi;
mod problem;
mod result;
mod routes;
mod state;
mod surface_format;
mod upload;
mod upload_body;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::middleware::{from_fn, from_fn_with_state};
use utoipa_swagger_ui::SwaggerUi;

pub use extract::{JsonFault, strict_json, strict_value};
pub use openapi::{openapi, openapi_json};
pub use problem::{Problem, ProblemDocument, ProblemField};
pub use state::{AppState, HttpLimits};

use prosopon_contract::FaultKind;

/// The router of the whole API.
pub fn app(state: AppState) -> Router {
    let (plain, uploads) = routes::all();
    let plain = plain.split_for_parts().0.layer(DefaultBodyLimit::max(state.limits.max_json_bytes));
    let uploads = uploads.split_for_parts().0.layer(DefaultBodyLimit::disable());
    let api = plain.merge(uploads).merge(routes::viewer_files()).with_state(state.clone());
    with_bounds(api.merge(SwaggerUi::new("/docs").url("/openapi.json", openapi())), state)
}

/// The router of a worker, which only computes jobs: health and metrics.
pub fn worker_app(state: AppState) -> Router {
    with_bounds(routes::health().split_for_parts().0.with_state(state.clone()), state)
}

fn with_bounds(routes: Router, state: AppState) -> Router {
    routes
        .fallback(unknown_path)
        .method_not_allowed_fallback(wrong_method)
        .layer(middleware::compression())
        .layer(from_fn(middleware::mark_compressed))
        .layer(from_fn_with_state(state.limits.answer, middleware::catch_errors))
        .layer(from_fn_with_state(middleware::KnownParameters::of(openapi()), middleware::known_parameters_only))
        .layer(from_fn_with_state(state.clone(), middleware::keep_room))
        .layer(from_fn_with_state(state.clone(), middleware::guard))
        .layer(middleware::cors(&state.origins))
        .layer(from_fn_with_state(state.clone(), middleware::check_host))
        .layer(from_fn_with_state(state.tls, middleware::security_headers))
        .layer(from_fn_with_state(state.limits.upload_idle, middleware::take_whole_body))
        .layer(from_fn(middleware::request_span))
}

async fn unknown_path() -> Problem {
    Problem::new(FaultKind::NotFound, "there is nothing at this path; /openapi.json lists all paths")
}

async fn wrong_method() -> Problem {
    Problem::new(FaultKind::MethodNotAllowed, "the Allow header names the methods of this path")
}
