use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};

use crate::http::{AppState, Problem};
use crate::session::FaultKind;

/// Whether the process lives
#[utoipa::path(get, path = "/livez", tag = "health", responses((status = 200, description = "it does", body = String)))]
pub(in crate::http) async fn livez() -> &'static str {
    "ok\n"
}

/// Whether requests can be served
///
/// The store answers and the service is not stopping.
#[utoipa::path(get, path = "/readyz", tag = "health", responses((status = 200, description = "they can", body = String)))]
pub(in crate::http) async fn readyz(State(state): State<AppState>) -> Result<&'static str, Problem> {
    if state.service.stopping().is_cancelled() {
        return Err(Problem::new(FaultKind::ShuttingDown, "the service is stopping"));
    }
    state.service.store().check().await?;
    Ok("ok\n")
}

/// Metrics
///
/// Prometheus text.
#[utoipa::path(get, path = "/metrics", tag = "health",
    responses((status = 200, description = "the metrics", body = String, content_type = "text/plain")))]
pub(in crate::http) async fn metrics(State(state): State<AppState>) -> Result<Response, Problem> {
    let (waiting, _) = state.service.store().waiting(0).await?;
    metrics::gauge!("prosopon_jobs_waiting").set(f64::from(waiting));
    let text = state.metrics.as_ref().map(|m| m.render()).unwrap_or_default();
    Ok(([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], text).into_response())
}
