use std::collections::BTreeSet;

use axum::body::Bytes;
use axum::extract::rejection::BytesRejection;
use axum::extract::{FromRequest, Request};
use axum::http::{HeaderMap, header};
use serde::de::DeserializeOwned;
use serde_json::Value;
use serde_path_to_error::{Path, Segment};

use super::messages::{api_message, quoted_name};
use super::strict::{Strict, Unique};
use crate::http::{AppState, Problem};
use prosopon_contract::{Check, Fault, FaultKind};

/// Most faults of a body that are reported.
const MOST_FAULTS: usize = 20;
/// Longest body that is searched for more than one fault, bytes: each further fault costs a further reading.
const SEARCHED: usize = 64 << 10;

/// A JSON body. The types themselves refuse unknown members.
#[derive(Debug)]
pub(in crate::http) struct Body<T>(pub(in crate::http) T);

impl<T: DeserializeOwned> FromRequest<AppState> for Body<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &AppState) -> Result<Self, Problem> {
        let bytes = read_json(request, state).await?;
        parse(&bytes).map(Self)
    }
}

/// The bytes of a JSON body; an empty body counts as `{}`.
pub(super) async fn read_json(request: Request, state: &AppState) -> Result<Bytes, Problem> {
    let headers = request.headers().clone();
    as_json(&headers, read_bytes(request, state).await?)
}

/// The bytes of a body that may be as long as JSON.
pub(super) async fn read_bytes(request: Request, state: &AppState) -> Result<Bytes, Problem> {
    let max_bytes = state.limits.max_json_bytes;
    let bytes = tokio::time::timeout(state.limits.body, Bytes::from_request(request, state)).await;
    let bytes = bytes.map_err(|_| {
        let detail = format!("the body did not arrive within {} s; send it again", state.limits.body.as_secs());
        Problem::new(FaultKind::Timeout, detail)
    })?;
    bytes.map_err(|e| too_large_or_broken(&e, max_bytes))
}

/// Checks that the headers say JSON; an empty body counts as `{}`.
pub(super) fn as_json(headers: &HeaderMap, bytes: Bytes) -> Result<Bytes, Problem> {
    if bytes.is_empty() {
        return Ok(Bytes::from_static(b"{}"));
    }
    if headers.get(header::CONTENT_ENCODING).is_some_and(|e| e != "identity") {
        return Err(Problem::new(
            FaultKind::UnsupportedFormat,
            "a JSON body cannot have a Content-Encoding; send it uncompressed",
        ));
    }
    if !is_json(headers) {
        return Err(Problem::new(FaultKind::UnsupportedFormat, "the body must have Content-Type application/json"));
    }
    Ok(bytes)
}

fn is_json(headers: &HeaderMap) -> bool {
    let kind = headers.get(header::CONTENT_TYPE).and_then(|t| t.to_str().ok()).unwrap_or_default();
    let essence = kind.split(';').next().unwrap_or_default().trim().to_ascii_lowercase();
    essence == "application/json" || (essence.starts_with("application/") && essence.ends_with("+json"))
}

fn too_large_or_broken(rejection: &BytesRejection, max_bytes: usize) -> Problem {
    if rejection.status() == axum::http::StatusCode::PAYLOAD_TOO_LARGE {
        let detail = format!("the JSON body is longer than the allowed {max_bytes} bytes");
        Problem(Fault::new(FaultKind::TooLarge, detail).with("allowed_bytes", max_bytes))
    } else {
        Problem::new(FaultKind::MalformedRequest, "the body broke off; send it again")
    }
}

/// Reads JSON.
///
/// A syntax error is malformed-request; wrong members or types are invalid-request, with their JSON pointer.
pub(super) fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Problem> {
    strict_json(bytes).map_err(|fault| match fault {
        JsonFault::NoJson(e) => Problem::new(FaultKind::MalformedRequest, format!("the body is not JSON: {e}")),
        JsonFault::NotAsExpected(error) => all_faults::<T>(bytes, error),
    })
}

/// The problem of a body whose first fault is `first`, with its other faults.
///
/// A reader stops at a fault. So the member with the fault is taken out, and the rest is read again.
fn all_faults<T: DeserializeOwned>(bytes: &[u8], first: serde_path_to_error::Error<serde_json::Error>) -> Problem {
    let (mut rest, mut found) = (serde_json::from_slice::<Value>(bytes).unwrap_or_default(), Vec::new());
    let mut taken = BTreeSet::new();
    let mut next = Some(first);
    while let Some(error) = next.take().filter(|_| found.len() < MOST_FAULTS) {
        let (pointer, message) = (pointer_of(error.path()), error.inner().to_string());
        let missing = quoted_name(&message).filter(|_| message.starts_with("missing field"));
        // What was taken out is no further fault; the object that needs it goes too.
        if missing.is_none_or(|name| !taken.contains(&format!("{pointer}/{name}"))) {
            found.push((pointer.clone(), api_message(&message)));
        }
        let Some(member) = take_out(&mut rest, &pointer) else { break };
        taken.insert(member);
        if bytes.len() > SEARCHED {
            break;
        }
        next = match strict_value::<T>(&rest) {
            Err(JsonFault::NotAsExpected(error)) => Some(error),
            Err(JsonFault::NoJson(_)) | Ok(_) => None,
        };
    }
    match found.as_slice() {
        [(pointer, detail)] => Problem(Fault::new(FaultKind::InvalidRequest, detail).at(pointer)),
        _ => {
            let mut check = Check::default();
            found.into_iter().for_each(|(pointer, detail)| check.fault(pointer, detail));
            let unread = || Fault::new(FaultKind::InvalidRequest, "the body cannot be read");
            Problem(check.finish().err().unwrap_or_else(unread))
        }
    }
}

/// Takes out the innermost member of an object that `pointer` lies in; returns its pointer.
fn take_out(value: &mut Value, pointer: &str) -> Option<String> {
    let mut inner = pointer;
    while let Some((outer, name)) = inner.rsplit_once('/') {
        if let Some(Value::Object(members)) = value.pointer_mut(outer) {
            members.remove(&name.replace("~1", "/").replace("~0", "~"))?;
            return Some(inner.to_owned());
        }
        inner = outer;
    }
    None
}

/// Why JSON cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum JsonFault {
    /// The bytes are not JSON.
    #[error("{0}")]
    NoJson(#[from] serde_json::Error),
    /// A member is unknown, missing, repeated or of the wrong type; the error has its path.
    #[error("{0}")]
    NotAsExpected(#[from] serde_path_to_error::Error<serde_json::Error>),
}

/// Reads JSON strictly: a structure must be an object, and no object can repeat a member.
///
/// # Errors
/// [`JsonFault`] if the bytes are not JSON or do not match the type.
pub fn strict_json<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, JsonFault> {
    let mut reader = serde_json::Deserializer::from_slice(bytes);
    let Unique(value) = match serde_path_to_error::deserialize(&mut reader) {
        Err(error) if error.inner().is_data() => return Err(error.into()),
        Err(error) => return Err(error.into_inner().into()),
        Ok(value) => value,
    };
    reader.end()?;
    strict_value(&value)
}

/// Reads a parsed JSON value strictly: a structure must be an object.
///
/// # Errors
/// [`JsonFault::NotAsExpected`] if the value does not match the type.
pub fn strict_value<T: DeserializeOwned>(value: &Value) -> Result<T, JsonFault> {
    Ok(serde_path_to_error::deserialize(Strict(value))?)
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
    struct Sample {
        values: Vec<f64>,
        point: Option<[f64; 3]>,
        name: Option<Name>,
        plane: Option<Plane>,
        #[serde(default)]
        #[expect(dead_code)]
        planes: Vec<Plane>,
        #[serde(default)]
        #[expect(dead_code)]
        shape: Shape,
    }

    #[derive(Debug, serde::Deserialize)]
    struct Plane {
        point: [f64; 3],
        offset: f64,
    }

    #[derive(Debug, Default, serde::Deserialize)]
    #[serde(rename_all = "snake_case")]
    #[expect(dead_code)]
    enum Shape {
        #[default]
        None,
        Box(Vec<f64>),
    }

    #[derive(Debug, serde::Deserialize)]
    #[serde(rename_all = "snake_case")]
    enum Name {
        One,
    }

    fn check(text: &str, kind: FaultKind, pointer: Option<&str>) {
        let fault = parse::<Sample>(text.as_bytes()).unwrap_err().0;
        assert_eq!(fault.kind, kind, "{text}");
        assert_eq!(fault.errors.first().map(|e| e.pointer.as_str()), pointer, "{text}");
    }

    #[test]
    fn what_fits_is_read() {
        let text =
            r#"{"values": [1, 2.5], "point": [1, 2, 3], "name": "one", "plane": {"point": [0, 0, 1], "offset": -2}}"#;
        let read = parse::<Sample>(text.as_bytes()).unwrap();
        assert_eq!((read.values, read.point), (vec![1.0, 2.5], Some([1.0, 2.0, 3.0])));
        assert!(read.plane.is_some_and(|p| p.point == [0.0, 0.0, 1.0] && p.offset == -2.0) && read.name.is_some());
    }

    #[test]
    fn all_faults_of_a_body_are_reported_at_once() {
        let pointers = |text: &str| -> Vec<String> {
            parse::<Sample>(text.as_bytes()).unwrap_err().0.errors.iter().map(|e| e.pointer.clone()).collect()
        };
        let text =
            r#"{"value": [], "point": "x", "name": 3, "plane": {"point": [0, 0, true], "offset": "y"}, "values": [1]}"#;
        assert_eq!(pointers(text), ["/name", "/plane/offset", "/plane/point/2", "/point", "/value"]);
        // What was taken out is not reported as missing; what is missing is.
        assert_eq!(pointers(r#"{"values": {}, "name": 3}"#), ["/name", "/values"]);
        assert_eq!(pointers(r#"{"name": 3}"#), ["/name", ""]);
        assert_eq!(pointers(r#"{"values": [1, "x", "y"]}"#), ["/values/1"]);
    }

    #[test]
    fn faults_say_where_they_are() {
        check(r#"{"values": [1, "x"]}"#, FaultKind::InvalidRequest, Some("/values/1"));
        check(r#"{"value": []}"#, FaultKind::InvalidRequest, Some("/value"));
        check("{}", FaultKind::InvalidRequest, Some(""));
        check("5", FaultKind::InvalidRequest, Some(""));
        check("[]", FaultKind::InvalidRequest, Some(""));
        check(r#"{"values": [], "values": []}"#, FaultKind::InvalidRequest, Some("/values"));
        check(r#"{"values": [], "point": [1, 2, 3, 4]}"#, FaultKind::InvalidRequest, Some("/point"));
        check(r#"{"values": [], "name": 3}"#, FaultKind::InvalidRequest, Some("/name"));
        check(r#"{"values": [], "shape": {"box": [1, 2], "other": 3}}"#, FaultKind::InvalidRequest, Some("/shape"));
        check(r#"{"values": [], "shape": {}}"#, FaultKind::InvalidRequest, Some("/shape"));
        check(r#"{"values": [], "shape": 5}"#, FaultKind::InvalidRequest, Some("/shape"));
        check(r#"{"values": [], "shape": {"box": [1, "x"]}}"#, FaultKind::InvalidRequest, Some("/shape/box/1"));
        check(r#"{"values": [], "plane": [[1, 2, 3], 4]}"#, FaultKind::InvalidRequest, Some("/plane"));
        check(
            r#"{"values": [], "planes": [{"point": [1, 2, 3], "offset": 4}, [[1, 2, 3], 4]]}"#,
            FaultKind::InvalidRequest,
            Some("/planes/1"),
        );
        check(
            r#"{"values": [], "plane": {"point": [1, 2, 3], "offset": 4, "offset": 5}}"#,
            FaultKind::InvalidRequest,
            Some("/plane/offset"),
        );
        check(r#"{"values": {}, "plane": null}"#, FaultKind::InvalidRequest, Some("/values"));
        check(r#"{"values": [1e999]}"#, FaultKind::MalformedRequest, None);
        check(r#"{"values": [NaN]}"#, FaultKind::MalformedRequest, None);
        check(r#"{"values": []} x"#, FaultKind::MalformedRequest, None);
        check("", FaultKind::MalformedRequest, None);
    }
}
