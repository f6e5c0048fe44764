use std::time::Duration;

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};

use crate::http::{AppState, Problem};
use prosopon_session::FaultKind;
use prosopon_store::Lane;

/// Longest wait for what the database tells of a queue: scrapers wait for ten seconds.
const QUEUE_TOLD: Duration = Duration::from_secs(2);

/// Whether the process lives
///
/// True while a solver is busy; false when the scheduler does not move any more, or work does not stop that should have. Then only a
/// restart helps: jobs are taken up again.
#[utoipa::path(get, path = "/livez", tag = "health", responses((status = 200, description = "it does", body = String)))]
pub(in crate::http) async fn livez(State(state): State<AppState>) -> Result<&'static str, Problem> {
    let wedged = state.service.wedged();
    if wedged.is_empty() {
        return Ok("ok\n");
    }
    tracing::error!(wedged = wedged.join("; "), "the service is wedged");
    Err(Problem::new(FaultKind::Internal, "the scheduler is wedged; the log says more"))
}

/// Whether requests can be served
///
/// The database answers, the bucket refuses neither this process nor what its jobs write, and the service is not stopping. A bucket that is away
/// for a while does not count: what needs none is answered, and jobs wait.
#[utoipa::path(get, path = "/readyz", tag = "health", responses((status = 200, description = "they can", body = String)))]
pub(in crate::http) async fn readyz(State(state): State<AppState>) -> Result<&'static str, Problem> {
    if state.service.is_draining() {
        return Err(Problem::new(FaultKind::ShuttingDown, "the service is stopping"));
    }
    state.service.store().check().await?;
    if state.service.is_refused() {
        return Err(Problem::new(FaultKind::StoreRefuses, "the bucket does not let jobs write; the log says more"));
    }
    Ok("ok\n")
}

/// Metrics
///
/// Prometheus text. While the database does not answer, what it would tell of the queue is not a number.
#[utoipa::path(get, path = "/metrics", tag = "health",
    responses((status = 200, description = "the metrics", body = String, content_type = "text/plain")))]
pub(in crate::http) async fn metrics(State(state): State<AppState>) -> Response {
    let mut waiting_in_all = 0.0;
    for lane in Lane::ALL {
        let queue = tokio::time::timeout(QUEUE_TOLD, state.service.store().queue(lane)).await;
        let waiting = queue.ok().and_then(Result::ok).map_or(f64::NAN, |queue| queue.len() as f64);
        metrics::gauge!("prosopon_queue_depth", "lane" => lane.as_str()).set(waiting);
        metrics::gauge!("prosopon_jobs_running", "lane" => lane.as_str()).set(state.service.running_in(lane) as f64);
        waiting_in_all += waiting;
    }
    metrics::gauge!("prosopon_jobs_waiting").set(waiting_in_all);
    if let Some(bytes) = resident_bytes() {
        metrics::gauge!("prosopon_resident_bytes").set(bytes as f64);
    }
    let text = state.metrics.as_ref().map(|m| m.render()).unwrap_or_default();
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], text).into_response()
}

/// Memory of the process, where the system tells.
fn resident_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:"))?;
    line.trim().trim_end_matches(" kB").parse::<u64>().ok().map(|kb| kb * 1024)
}
