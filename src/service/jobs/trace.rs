//! Trace context: from a request's header to its span, and on to the job that a worker begins later.

use opentelemetry::Context;
use opentelemetry::propagation::TextMapPropagator;
use opentelemetry_sdk::propagation::TraceContextPropagator;
use tracing::Span;
use tracing_opentelemetry::OpenTelemetrySpanExt;

/// Name of the W3C Trace Context header.
pub const TRACEPARENT: &str = "traceparent";

/// Makes a span that was not entered yet part of the trace in `traceparent`.
///
/// Invalid values are ignored.
pub fn continue_from(span: &Span, traceparent: &str) {
    let Ok(value) = traceparent.parse() else { return };
    let headers = [(http::HeaderName::from_static(TRACEPARENT), value)].into_iter().collect();
    let carrier = opentelemetry_http::HeaderExtractor(&headers);
    let parent = TraceContextPropagator::new().extract_with_context(&Context::new(), &carrier);
    // Fails when no spans are exported.
    span.set_parent(parent).ok();
}

/// The `traceparent` value for work that a span starts; `None` when no spans are exported.
#[must_use]
pub fn traceparent(span: &Span) -> Option<String> {
    let mut headers = http::HeaderMap::new();
    TraceContextPropagator::new()
        .inject_context(&span.context(), &mut opentelemetry_http::HeaderInjector(&mut headers));
    Some(headers.get(TRACEPARENT)?.to_str().ok()?.to_owned())
}
