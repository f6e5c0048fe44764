//! Immutable answers: strong entity tags, conditional and range requests.

use axum::body::Bytes;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::Problem;
use prosopon_contract::FaultKind;
use prosopon_session::key_of;

/// Entity tag of a result that this version of the software makes from `parts`.
pub(super) fn tag_of(parts: &[&str]) -> String {
    let mut all = vec![env!("CARGO_PKG_VERSION")];
    all.extend_from_slice(parts);
    format!("\"{}\"", key_of(&all))
}

/// Answer 304 if the client already has the tagged result.
pub(super) fn not_modified(request: &HeaderMap, tag: &str) -> Option<Response> {
    let known = request.get(header::IF_NONE_MATCH)?.to_str().ok()?;
    let matches = known.split(',').map(str::trim).any(|t| t == "*" || t.trim_start_matches("W/") == tag);
    matches.then(|| (StatusCode::NOT_MODIFIED, [(header::ETAG, tag.to_owned())]).into_response())
}

/// Sends the tagged result, whole or in the requested range; answers 304 if the client already has it.
pub(super) fn tagged(request: &HeaderMap, tag: &str, media_type: &str, body: Bytes) -> Result<Response, Problem> {
    if let Some(known) = not_modified(request, tag) {
        return Ok(known);
    }
    let headers = [
        (header::CONTENT_TYPE, media_type.to_owned()),
        (header::ETAG, tag.to_owned()),
        (header::CACHE_CONTROL, "private, no-cache".to_owned()),
        (header::ACCEPT_RANGES, "bytes".to_owned()),
    ];
    let Some((first, last)) = range(request, tag, body.len())? else {
        return Ok((headers, body).into_response());
    };
    let content_range = format!("bytes {first}-{last}/{}", body.len());
    let mut response = (StatusCode::PARTIAL_CONTENT, headers, body.slice(first..=last)).into_response();
    if let Ok(value) = HeaderValue::from_str(&content_range) {
        response.headers_mut().insert(header::CONTENT_RANGE, value);
    }
    Ok(response)
}

/// First and last byte of a single range; a request for several ranges gets the whole result.
fn range(request: &HeaderMap, tag: &str, length: usize) -> Result<Option<(usize, usize)>, Problem> {
    let text = |name| request.get(name).and_then(|v: &HeaderValue| v.to_str().ok());
    if text(header::IF_RANGE).is_some_and(|t| t != tag) {
        return Ok(None);
    }
    let Some(spec) = text(header::RANGE).and_then(|r| r.strip_prefix("bytes=")) else { return Ok(None) };
    let Some((first, last)) = spec.split_once('-').filter(|_| !spec.contains(',')) else { return Ok(None) };
    let range = match (first.trim().parse::<usize>(), last.trim().parse::<usize>()) {
        (Ok(first), Ok(last)) if first <= last => (first, last.min(length.saturating_sub(1))),
        (Ok(first), Err(_)) if last.trim().is_empty() => (first, length.saturating_sub(1)),
        (Err(_), Ok(suffix)) if first.trim().is_empty() && suffix > 0 => {
            (length.saturating_sub(suffix), length.saturating_sub(1))
        }
        _ => return Ok(None),
    };
    if range.0 >= length {
        let detail = format!("the range starts behind the end of the result, which has {length} bytes");
        return Err(Problem(
            prosopon_contract::Fault::new(FaultKind::RangeNotSatisfiable, detail).with("bytes", length),
        ));
    }
    Ok(Some(range))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(value: &str, expected: Option<(usize, usize)>) {
        let mut headers = HeaderMap::new();
        headers.insert(header::RANGE, HeaderValue::from_str(value).unwrap());
        assert_eq!(range(&headers, "\"t\"", 10).unwrap(), expected, "{value}");
    }

    #[test]
    fn single_ranges_are_understood() {
        check("bytes=0-3", Some((0, 3)));
        check("bytes=4-", Some((4, 9)));
        check("bytes=-2", Some((8, 9)));
        check("bytes=5-99", Some((5, 9)));
        check("bytes=0-1,4-5", None);
        check("lines=0-1", None);
        check("bytes=3-1", None);
        let mut headers = HeaderMap::new();
        headers.insert(header::RANGE, HeaderValue::from_static("bytes=10-"));
        assert!(range(&headers, "\"t\"", 10).is_err());
    }

    #[test]
    fn a_known_tag_is_not_sent_again() {
        let mut headers = HeaderMap::new();
        headers.insert(header::IF_NONE_MATCH, HeaderValue::from_static("\"a\", \"b\""));
        assert_eq!(not_modified(&headers, "\"b\"").unwrap().status(), StatusCode::NOT_MODIFIED);
        assert!(not_modified(&headers, "\"c\"").is_none());
    }
}
