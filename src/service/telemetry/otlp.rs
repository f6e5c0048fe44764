//! Sends spans to an OpenTelemetry collector, as JSON over HTTP. Log lines are not sent.

use std::io;
use std::time::Duration;

use opentelemetry::KeyValue;
use opentelemetry::trace::TracerProvider;
use opentelemetry_http::{Bytes, HttpClient, HttpError, Request, Response};
use opentelemetry_otlp::{Protocol, SpanExporter, WithExportConfig, WithHttpConfig};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::trace::{SdkTracer, SdkTracerProvider};
use tracing::Level;
use tracing::level_filters::LevelFilter;
use tracing_opentelemetry::OpenTelemetryLayer;
use tracing_subscriber::filter::FilterFn;
use tracing_subscriber::{Layer, Registry};

/// Longest time for sending one batch of spans.
const PATIENCE: Duration = Duration::from_secs(4);

/// Blocking HTTP client; it runs on the exporter's own thread.
#[derive(Debug)]
struct Client(ureq::Agent);

#[async_trait::async_trait]
impl HttpClient for Client {
    async fn send_bytes(&self, request: Request<Bytes>) -> Result<Response<Bytes>, HttpError> {
        let (parts, body) = self.0.run(request.map(|body| body.to_vec()))?.into_parts();
        let mut body = body;
        Ok(Response::from_parts(parts, body.read_to_vec()?.into()))
    }
}

/// Makes a tracer provider that sends spans to the collector at `endpoint`.
pub(super) fn provider(endpoint: &str) -> io::Result<SdkTracerProvider> {
    let agent = ureq::Agent::config_builder().timeout_global(Some(PATIENCE)).http_status_as_error(false).build();
    let exporter = SpanExporter::builder()
        .with_http()
        .with_http_client(Client(agent.into()))
        .with_protocol(Protocol::HttpJson)
        .with_endpoint(format!("{}/v1/traces", endpoint.trim_end_matches('/')))
        .build()
        .map_err(io::Error::other)?;
    let version = KeyValue::new("service.version", env!("CARGO_PKG_VERSION"));
    let resource = Resource::builder().with_service_name("prosopon").with_attribute(version).build();
    Ok(SdkTracerProvider::builder().with_resource(resource).with_batch_exporter(exporter).build())
}

/// Layer that passes the program's own spans to a provider.
pub(super) fn layer(provider: &SdkTracerProvider) -> impl Layer<Registry> + use<> {
    let ours =
        FilterFn::new(|data| data.is_span() && *data.level() <= Level::INFO && data.target().starts_with("prosopon"));
    let layer: OpenTelemetryLayer<Registry, SdkTracer> =
        tracing_opentelemetry::layer().with_tracer(provider.tracer("prosopon"));
    let bare = layer.with_location(false).with_threads(false).with_tracked_inactivity(false).with_target(false);
    bare.with_filter(ours.with_max_level_hint(LevelFilter::INFO))
}
