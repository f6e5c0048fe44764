//! Logs and metrics of the process.

use std::io::IsTerminal;
use std::sync::OnceLock;

use metrics_exporter_prometheus::{PrometheusBuilder, PrometheusHandle};
use tracing_subscriber::EnvFilter;

use crate::config::LogFormat;

/// Bounds of the histograms' buckets, s: from the answer out of memory to the job of an hour.
const SECONDS: &[f64] =
    &[0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0, 300.0, 1800.0, 7200.0];

static METRICS: OnceLock<Option<PrometheusHandle>> = OnceLock::new();

/// Sends the log to stderr: text on a terminal, JSON lines otherwise. `RUST_LOG` chooses what; `level` where it is not set.
pub fn start_log(level: &str) {
    start_log_as(level, LogFormat::Auto);
}

/// The same in a given format.
pub fn start_log_as(level: &str, format: LogFormat) {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(level));
    let builder = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    // A second start (tests, the demo) keeps the first.
    let text = match format {
        LogFormat::Auto => std::io::stderr().is_terminal(),
        LogFormat::Text => true,
        LogFormat::Json => false,
    };
    if text {
        builder.try_init().ok();
    } else {
        builder.json().try_init().ok();
    }
}

/// Installs the recorder of the process, once; `None` when something else has installed one.
pub fn start_metrics() -> Option<PrometheusHandle> {
    METRICS
        .get_or_init(|| {
            // Histograms, not summaries: their memory does not grow, and several nodes can be added up.
            let builder = PrometheusBuilder::new();
            let recorder = builder.set_buckets(SECONDS).unwrap_or_default().build_recorder();
            let handle = recorder.handle();
            metrics::set_global_recorder(recorder).ok().map(|()| handle)
        })
        .clone()
}
