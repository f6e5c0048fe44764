//! Where a trace goes on: from a request's header to its span, and from there to the job, which a worker begins later.
//!
//! Without the feature `otlp` nobody receives spans, and nothing here does anything.

use tracing::Span;

/// The header of W3C Trace Context.
pub const TRACEPARENT: &str = "traceparent";

/// Makes a span that was not entered yet a part of the trace that the value of `traceparent` names; another value is ignored.
#[cfg(feature = "otlp")]
pub fn continue_from(span: &Span, traceparent: &str) {
    use opentelemetry::Context;
    use opentelemetry::propagation::TextMapPropagator;
    use opentelemetry_sdk::propagation::TraceContextPropagator;
    use tracing_opentelemetry::OpenTelemetrySpanExt;
    let Ok(value) = traceparent.parse() else { return };
    let headers = [(http::HeaderName::from_static(TRACEPARENT), value)].into_iter().collect();
    let carrier = opentelemetry_http::HeaderExtractor(&headers);
    let parent = TraceContextPropagator::new().extract_with_context(&Context::new(), &carrier);
    // Fails where nobody receives spans.
    span.set_parent(parent).ok();
}

/// The value of `traceparent` for what a span leads to, where somebody receives spans.
#[cfg(feature = "otlp")]
#[must_use]
pub fn traceparent(span: &Span) -> Option<String> {
    use opentelemetry::propagation::TextMapPropagator;
    use opentelemetry_sdk::propagation::TraceContextPropagator;
    use tracing_opentelemetry::OpenTelemetrySpanExt;
    let mut headers = http::HeaderMap::new();
    TraceContextPropagator::new()
        .inject_context(&span.context(), &mut opentelemetry_http::HeaderInjector(&mut headers));
    Some(headers.get(TRACEPARENT)?.to_str().ok()?.to_owned())
}

/// Nobody receives spans.
#[cfg(not(feature = "otlp"))]
pub fn continue_from(_: &Span, _: &str) {}

/// Nobody receives spans.
#[cfg(not(feature = "otlp"))]
#[must_use]
pub fn traceparent(_: &Span) -> Option<String> {
    None
}
