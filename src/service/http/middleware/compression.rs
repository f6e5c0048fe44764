use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::Response;
use tower_http::compression::CompressionLayer;
use tower_http::compression::predicate::{DefaultPredicate, NotForContentType, Predicate};

/// Compresses answers with gzip or zstd, except pictures and streams.
///
/// A stream must not wait for a full block.
pub(in crate::http) fn compression() -> CompressionLayer<impl Predicate> {
    let predicate = DefaultPredicate::new().and(NotForContentType::const_new("application/x-ndjson"));
    CompressionLayer::new().gzip(true).zstd(true).compress_when(predicate)
}

/// Gives a compressed answer an entity tag of its own and recognises it in If-None-Match.
///
/// A strong tag names exact bytes, so the compressed and the plain form need different tags.
pub(in crate::http) async fn mark_compressed(mut request: Request, next: Next) -> Response {
    let known = strip_mark(request.headers_mut());
    let mut response = next.run(request).await;
    let is_not_modified = response.status() == StatusCode::NOT_MODIFIED;
    let headers = response.headers_mut();
    let Some(tag) = headers.get(header::ETAG).and_then(|t| t.to_str().ok()).map(str::to_owned) else { return response };
    for encoding in ENCODINGS {
        let marked = with_mark(&tag, encoding);
        let is_encoded = headers.get(header::CONTENT_ENCODING).is_some_and(|e| e == encoding);
        // An answer 304 carries the tag that the client sent.
        let has_marked = is_not_modified && known.as_ref().is_some_and(|tags| tags.contains(&marked));
        if (is_encoded || has_marked)
            && let Ok(marked) = HeaderValue::from_str(&marked)
        {
            headers.insert(header::ETAG, marked);
        }
    }
    response
}

/// Content encodings, by their names in HTTP.
const ENCODINGS: [&str; 2] = ["gzip", "zstd"];

fn with_mark(tag: &str, encoding: &str) -> String {
    format!("{}-{encoding}\"", tag.trim_end_matches('"'))
}

/// Removes the encodings from the tags of If-None-Match and returns its original value.
fn strip_mark(headers: &mut HeaderMap) -> Option<String> {
    let tags = headers.get(header::IF_NONE_MATCH)?.to_str().ok()?.to_owned();
    let stripped = ENCODINGS.iter().fold(tags.clone(), |tags, e| tags.replace(&format!("-{e}\""), "\""));
    if let Ok(stripped) = HeaderValue::from_str(&stripped) {
        headers.insert(header::IF_NONE_MATCH, stripped);
    }
    Some(tags)
}
