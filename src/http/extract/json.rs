use axum::body::Bytes;
use axum::extract::rejection::BytesRejection;
use axum::extract::{FromRequest, Request};
use axum::http::{HeaderMap, header};
use serde::de::DeserializeOwned;
use serde_json::error::Category;
use serde_path_to_error::{Path, Segment};

use crate::http::Problem;
use crate::session::{Fault, FaultKind};

/// A JSON body. Unknown members are refused by the types themselves.
#[derive(Debug)]
pub(in crate::http) struct Body<T>(pub(in crate::http) T);

impl<S: Send + Sync, T: DeserializeOwned> FromRequest<S> for Body<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let bytes = read_json(request, state).await?;
        parse(&bytes).map(Self)
    }
}

/// The bytes of a JSON body; an empty one counts as `{}`.
pub(super) async fn read_json<S: Send + Sync>(request: Request, state: &S) -> Result<Bytes, Problem> {
    let is_json = is_json(request.headers());
    let bytes = Bytes::from_request(request, state).await.map_err(|e| too_large_or_broken(&e))?;
    if bytes.is_empty() {
        return Ok(Bytes::from_static(b"{}"));
    }
    if !is_json {
        return Err(Problem::new(FaultKind::UnsupportedFormat, "the body must have Content-Type application/json"));
    }
    Ok(bytes)
}

fn is_json(headers: &HeaderMap) -> bool {
    let kind = headers.get(header::CONTENT_TYPE).and_then(|t| t.to_str().ok()).unwrap_or_default();
    let essence = kind.split(';').next().unwrap_or_default().trim().to_ascii_lowercase();
    essence == "application/json" || (essence.starts_with("application/") && essence.ends_with("+json"))
}

fn too_large_or_broken(rejection: &BytesRejection) -> Problem {
    if rejection.status() == axum::http::StatusCode::PAYLOAD_TOO_LARGE {
        Problem::new(FaultKind::TooLarge, "the JSON body is longer than allowed")
    } else {
        Problem::new(FaultKind::MalformedRequest, "the body broke off")
    }
}

/// Reads JSON; what cannot be parsed is malformed, what has the wrong members or types is invalid, with its pointer.
pub(super) fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Problem> {
    // Types would also take their members in order from a list.
    if bytes.trim_ascii_start().starts_with(b"[") {
        let fault = Fault::new(FaultKind::InvalidRequest, "the body must be a JSON object, found a list");
        return Err(Problem(fault.at("")));
    }
    let mut deserializer = serde_json::Deserializer::from_slice(bytes);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| {
        let pointer = pointer_of(error.path());
        let inner = error.into_inner();
        match inner.classify() {
            Category::Data => Problem(Fault::new(FaultKind::InvalidRequest, inner.to_string()).at(&pointer)),
            Category::Syntax | Category::Eof | Category::Io => {
                Problem::new(FaultKind::MalformedRequest, format!("the body is no JSON: {inner}"))
            }
        }
    })?;
    let rest = deserializer.end();
    rest.map_err(|e| Problem::new(FaultKind::MalformedRequest, format!("the body is no JSON: {e}")))?;
    Ok(value)
}

fn pointer_of(path: &Path) -> String {
    path.iter()
        .map(|segment| match segment {
            Segment::Seq { index } => format!("/{index}"),
            Segment::Map { key } => format!("/{}", key.replace('~', "~0").replace('/', "~1")),
            Segment::Enum { variant } => format!("/{variant}"),
            Segment::Unknown => String::new(),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code)]
    struct Sample {
        values: Vec<f64>,
    }

    fn check(text: &str, kind: FaultKind, pointer: Option<&str>) {
        let fault = parse::<Sample>(text.as_bytes()).unwrap_err().0;
        assert_eq!(fault.kind, kind, "{text}");
        assert_eq!(fault.errors.first().map(|e| e.pointer.as_str()), pointer, "{text}");
    }

    #[test]
    fn faults_say_where_they_are() {
        check(r#"{"values": [1, "x"]}"#, FaultKind::InvalidRequest, Some("/values/1"));
        check(r#"{"value": []}"#, FaultKind::InvalidRequest, Some("/value"));
        check("{}", FaultKind::InvalidRequest, Some(""));
        check(r#"{"values": [1e999]}"#, FaultKind::MalformedRequest, None);
        check(r#"{"values": [NaN]}"#, FaultKind::MalformedRequest, None);
        check(r#"{"values": []} x"#, FaultKind::MalformedRequest, None);
        check("", FaultKind::MalformedRequest, None);
    }
}
