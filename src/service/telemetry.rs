//! Logs, metrics and traces of the process.

mod otlp;

use std::io::IsTerminal;
use std::sync::OnceLock;

use metrics_exporter_prometheus::{PrometheusBuilder, PrometheusHandle};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer, Registry, fmt};

use crate::config::{LogFormat, ServeConfig};

/// Bounds of the histogram buckets, s: from answers out of memory to jobs of two hours.
const SECONDS: &[f64] =
    &[0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0, 300.0, 1800.0, 7200.0];

static METRICS: OnceLock<Option<PrometheusHandle>> = OnceLock::new();

/// Starts the log on stderr: text on a terminal, JSON lines otherwise.
///
/// `RUST_LOG` sets the level; if it is not set, `level` does.
pub fn start_log(level: &str) {
    install(level, LogFormat::Auto, None);
}

/// Starts the log as configured, and traces if a collector is configured.
///
/// # Errors
/// Fails if the exporter of spans cannot be built.
pub fn start(config: &ServeConfig) -> std::io::Result<Traces> {
    if let Some(endpoint) = &config.otlp_endpoint {
        let provider = otlp::provider(endpoint)?;
        install(&config.log_level, config.log_format, Some(Box::new(otlp::layer(&provider))));
        return Ok(Traces { provider: Some(provider) });
    }
    install(&config.log_level, config.log_format, None);
    Ok(Traces::default())
}

/// Guard of the span exporter; dropping it sends the last spans.
#[derive(Debug, Default)]
pub struct Traces {
    provider: Option<opentelemetry_sdk::trace::SdkTracerProvider>,
}

impl Drop for Traces {
    fn drop(&mut self) {
        if let Some(Err(error)) = self.provider.as_ref().map(|provider| provider.shutdown()) {
            tracing::warn!(%error, "the last spans could not be sent");
        }
    }
}

fn install(level: &str, format: LogFormat, traces: Option<Box<dyn Layer<Registry> + Send + Sync>>) {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(level));
    let text = match format {
        LogFormat::Auto => std::io::stderr().is_terminal(),
        LogFormat::Text => true,
        LogFormat::Json => false,
    };
    let log = fmt::layer().with_writer(std::io::stderr);
    let log = if text { log.boxed() } else { log.json().boxed() };
    // A second call, as in tests and the demo, keeps the first log.
    tracing_subscriber::registry().with(traces).with(log.with_filter(filter)).try_init().ok();
}

/// Installs the metrics recorder of the process once; `None` if other code has already installed one.
pub fn start_metrics() -> Option<PrometheusHandle> {
    METRICS
        .get_or_init(|| {
            // Histograms instead of summaries: their memory is constant, and those of several processes can be added.
            let builder = PrometheusBuilder::new();
            let recorder = builder.set_buckets(SECONDS).unwrap_or_default().build_recorder();
            let handle = recorder.handle();
            metrics::set_global_recorder(recorder).ok().map(|()| handle)
        })
        .clone()
}
