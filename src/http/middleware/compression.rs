use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::middleware::Next;
use axum::response::Response;
use tower_http::compression::CompressionLayer;
use tower_http::compression::predicate::{DefaultPredicate, NotForContentType, Predicate};

/// gzip where it helps; not for pictures, and not for streams, which must not wait for a full block.
pub(in crate::http) fn compression() -> CompressionLayer<impl Predicate> {
    let predicate = DefaultPredicate::new().and(NotForContentType::const_new("application/x-ndjson"));
    CompressionLayer::new().gzip(true).compress_when(predicate)
}

/// A strong tag names bytes: the compressed form gets a tag of its own, and is known again under it.
pub(in crate::http) async fn mark_compressed(mut request: Request, next: Next) -> Response {
    strip_mark(request.headers_mut());
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    let is_gzip = headers.get(header::CONTENT_ENCODING).is_some_and(|e| e == "gzip");
    if is_gzip && let Some(tag) = headers.get(header::ETAG).and_then(|t| t.to_str().ok()) {
        let marked = format!("{}-gzip\"", tag.trim_end_matches('"'));
        if let Ok(marked) = HeaderValue::from_str(&marked) {
            headers.insert(header::ETAG, marked);
        }
    }
    response
}

fn strip_mark(headers: &mut HeaderMap) {
    let Some(tags) = headers.get(header::IF_NONE_MATCH).and_then(|t| t.to_str().ok()) else { return };
    if let Ok(stripped) = HeaderValue::from_str(&tags.replace("-gzip\"", "\"")) {
        headers.insert(header::IF_NONE_MATCH, stripped);
    }
}
