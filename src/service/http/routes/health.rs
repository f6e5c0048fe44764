use std::time::Duration;

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};

use crate::http::{AppState, Problem};
use prosopon_contract::FaultKind;
use prosopon_store::Lane;

/// Longest wait for the database when metrics are read; Prometheus scrapers wait ten seconds in all.
const QUEUE_TOLD: Duration = Duration::from_secs(2);

/// Check that the process is alive
///
/// Succeeds while a solver is busy. Fails when the scheduler is stuck or when work does not stop in time; restart the process
/// then. The service resumes its jobs after the restart.
#[utoipa::path(get, path = "/livez", operation_id = "live", tag = "health", responses((status = 200, description = "Alive.", body = String)))]
pub(in crate::http) async fn livez(State(state): State<AppState>) -> Result<&'static str, Problem> {
    let stuck = state.service.stuck();
    if stuck.is_empty() {
        return Ok("ok\n");
    }
    tracing::error!(stuck = stuck.join("; "), "the service is stuck");
    Err(Problem::new(FaultKind::Internal, "the scheduler is stuck; see the log, and restart the process"))
}

/// Check that the service is ready
///
/// Succeeds when the database answers, the bucket accepts this process and the values that its jobs write, and the service is
/// not stopping. An unreachable bucket does not count: requests that need no bucket are answered, and jobs wait. Fails with
/// `storage-full` when the disk has less room than the setting `min_free_mb`; the answer says it before, below four times that.
/// Fails while a computation has ignored its stop for more than a second, because other jobs wait for its threads.
#[utoipa::path(get, path = "/readyz", operation_id = "ready", tag = "health", responses((status = 200, description = "Ready.", body = String)))]
pub(in crate::http) async fn readyz(State(state): State<AppState>) -> Result<String, Problem> {
    if state.service.is_draining() {
        return Err(Problem::new(FaultKind::ShuttingDown, "the service is stopping"));
    }
    state.service.store().check().await?;
    state.service.store().check_room()?;
    if state.service.is_refused() {
        return Err(Problem::new(FaultKind::StoreRefuses, "the bucket refuses writes of jobs; the log has its answer"));
    }
    if state.service.is_held() {
        let detail = "a stopped computation still holds threads of the jobs; if it ignores the stop for a minute, the process ends";
        return Err(Problem::new(FaultKind::Internal, detail));
    }
    Ok(match state.service.store().free_room()? {
        Some(free) if free.is_low_after(0) => format!(
            "ok, but the disk has {} MB left; below {} MB only reads and deletions are accepted\n",
            free.bytes >> 20,
            free.least >> 20
        ),
        _ => "ok\n".to_owned(),
    })
}

/// Read the metrics
///
/// Returns Prometheus text. Queue gauges are NaN while the database does not answer.
#[utoipa::path(get, path = "/metrics", operation_id = "metrics", tag = "health",
    responses((status = 200, description = "The metrics.", body = String, content_type = "text/plain")))]
pub(in crate::http) async fn metrics(State(state): State<AppState>) -> Response {
    let mut waiting_in_all = 0.0;
    for lane in Lane::ALL {
        let queue = tokio::time::timeout(QUEUE_TOLD, state.service.store().queue(lane)).await;
        let waiting = queue.ok().and_then(Result::ok).map_or(f64::NAN, |queue| queue.len() as f64);
        metrics::gauge!("prosopon_queue_depth", "lane" => lane.as_str()).set(waiting);
        metrics::gauge!("prosopon_jobs_running", "lane" => lane.as_str()).set(state.service.running_in(lane) as f64);
        waiting_in_all += waiting;
    }
    metrics::gauge!("prosopon_jobs_ignoring_stop").set(state.service.ignoring_stop() as f64);
    metrics::gauge!("prosopon_jobs_waiting").set(waiting_in_all);
    if let Ok(Some(free)) = state.service.store().free_room() {
        metrics::gauge!("prosopon_disk_free_bytes").set(free.bytes as f64);
    }
    if let Some(bytes) = resident_bytes() {
        metrics::gauge!("prosopon_resident_bytes").set(bytes as f64);
    }
    let text = state.metrics.as_ref().map(|m| m.render()).unwrap_or_default();
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], text).into_response()
}

/// Resident memory of the process, bytes; `None` on systems without `/proc`.
fn resident_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:"))?;
    line.trim().trim_end_matches(" kB").parse::<u64>().ok().map(|kb| kb * 1024)
}
