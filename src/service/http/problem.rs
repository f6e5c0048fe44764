use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use super::middleware::request_id;
use prosopon_contract::{Fault, FaultKind, FieldFault, Halt};
use prosopon_store::StoreError;

/// Media type of problems.
pub(super) const PROBLEM_JSON: &str = "application/problem+json";

/// Temporary problems, and the `Retry-After` of each, s.
const RETRY_AFTER: &[(&[FaultKind], &str)] = &[
    (&[FaultKind::QueueFull, FaultKind::TenantQueueFull, FaultKind::QuotaFull, FaultKind::StoreUnavailable], "10"),
    (&[FaultKind::ShuttingDown, FaultKind::NotReady], "2"),
];

/// A value of the request that is not allowed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ProblemField {
    /// JSON pointer of the value in the body, or the name of a query parameter or of an uploaded part.
    pub pointer: String,
    /// What was found and what is allowed.
    pub detail: String,
}

/// A problem document (RFC 9457). `api/problems.md` explains each type.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ProblemDocument {
    /// Type of the problem: `/problems/` followed by the name of its section in `api/problems.md`.
    #[serde(rename = "type")]
    pub problem_type: String,
    /// Short description of the type.
    pub title: String,
    /// HTTP status code.
    pub status: u16,
    /// What is wrong in this case, and what to do.
    pub detail: String,
    /// Id of the request in the log; absent in the problem of a job.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub request_id: Option<String>,
    /// Values of the request that are not allowed; absent if there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub errors: Vec<ProblemField>,
    /// Further members, which depend on the type.
    #[serde(flatten)]
    pub facts: Map<String, Value>,
}

impl From<&Fault> for ProblemDocument {
    fn from(fault: &Fault) -> Self {
        let (status, title) = status_and_title(fault.kind);
        let field = |f: &FieldFault| ProblemField { pointer: short(&f.pointer), detail: short(&f.detail) };
        Self {
            problem_type: format!("/problems/{}", fault.kind.slug()),
            title: title.to_owned(),
            status: status.as_u16(),
            detail: short(&fault.detail),
            request_id: None,
            errors: fault.errors.iter().map(field).collect(),
            facts: fault.facts.clone(),
        }
    }
}

/// Longest text of a problem, bytes: a name in a request can have megabytes.
const LONGEST: usize = 550;

/// A text without its middle if it is too long.
fn short(text: &str) -> String {
    if text.len() <= LONGEST {
        return text.to_owned();
    }
    let (begin, end) = (text.floor_char_boundary(LONGEST / 2), text.ceil_char_boundary(text.len() - LONGEST / 4));
    format!("{}…{}", &text[..begin], &text[end..])
}

/// An error answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Problem(pub(super) Fault);

impl Problem {
    pub(super) fn new(kind: FaultKind, detail: impl Into<String>) -> Self {
        Self(Fault::new(kind, detail))
    }
}

impl From<Fault> for Problem {
    fn from(fault: Fault) -> Self {
        Self(fault)
    }
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        Self(error.into())
    }
}

impl From<Halt> for Problem {
    fn from(halt: Halt) -> Self {
        Self(halt.into())
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let (status, _) = status_and_title(self.0.kind);
        let mut document = ProblemDocument::from(&self.0);
        document.request_id = request_id();
        let body = serde_json::to_string(&document).unwrap_or_default();
        let mut response = (status, [(header::CONTENT_TYPE, PROBLEM_JSON)], body).into_response();
        if self.0.kind == FaultKind::Unauthenticated {
            response.headers_mut().insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        for (kinds, seconds) in RETRY_AFTER {
            if kinds.contains(&self.0.kind) {
                response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from_static(seconds));
            }
        }
        response
    }
}

/// Status and title of each kind. The match has no wildcard, so that a new kind cannot be forgotten.
pub(super) fn status_and_title(kind: FaultKind) -> (StatusCode, &'static str) {
    use FaultKind as K;
    use StatusCode as S;
    match kind {
        K::DamagedValue => (S::INTERNAL_SERVER_ERROR, "A stored value is damaged"),
        K::MalformedRequest => (S::BAD_REQUEST, "The request cannot be read"),
        K::InvalidRequest => (S::UNPROCESSABLE_ENTITY, "Values of the request are not allowed"),
        K::NotFound => (S::NOT_FOUND, "The requested object does not exist"),
        K::Gone => (S::GONE, "The requested object was deleted"),
        K::MethodNotAllowed => (S::METHOD_NOT_ALLOWED, "The path does not support this method"),
        K::NotAcceptable => (S::NOT_ACCEPTABLE, "No accepted media type can be sent"),
        K::Timeout => (S::REQUEST_TIMEOUT, "The request took too long"),
        K::WrongState => (S::CONFLICT, "The object is in another state"),
        K::MissingInput => (S::CONFLICT, "A required input is missing"),
        K::Stale => (S::CONFLICT, "The object was made from earlier inputs"),
        K::TooLarge => (S::PAYLOAD_TOO_LARGE, "The body is longer than allowed"),
        K::RangeNotSatisfiable => (S::RANGE_NOT_SATISFIABLE, "The range lies outside the result"),
        K::UnsupportedFormat => (S::UNSUPPORTED_MEDIA_TYPE, "The format is not supported"),
        K::IdempotencyMismatch => (S::UNPROCESSABLE_ENTITY, "The idempotency key belongs to another request"),
        K::SurfaceNotUsable => (S::UNPROCESSABLE_ENTITY, "The surface is not usable"),
        K::VolumeNotUsable => (S::UNPROCESSABLE_ENTITY, "The CT volume is not usable"),
        K::AnatomyNotUsable => (S::UNPROCESSABLE_ENTITY, "Skin and skull do not fit together"),
        K::FieldNotUsable => (S::UNPROCESSABLE_ENTITY, "No distance field can be built"),
        K::MeshNotUsable => (S::UNPROCESSABLE_ENTITY, "No tissue mesh can be built"),
        K::CutMissesBone => (S::UNPROCESSABLE_ENTITY, "A cut misses the bone"),
        K::BoneNotParted => (S::UNPROCESSABLE_ENTITY, "The cuts do not separate the bone"),
        K::PlanNotUsable => (S::UNPROCESSABLE_ENTITY, "The bone paths are not usable"),
        K::SceneNotUsable => (S::UNPROCESSABLE_ENTITY, "Mesh, bone and settings cannot be solved together"),
        K::NotEnoughMemory => (S::UNPROCESSABLE_ENTITY, "The job would need too much memory"),
        K::SolverNotConverged => (S::UNPROCESSABLE_ENTITY, "Equilibrium was not reached"),
        K::SolverUnstable => (S::UNPROCESSABLE_ENTITY, "A material lost its stability"),
        K::SolverInverted => (S::UNPROCESSABLE_ENTITY, "Tissue cannot follow the bone"),
        K::SolverPenetration => (S::UNPROCESSABLE_ENTITY, "Tissue penetrates bone"),
        K::ComparisonNotUsable => (S::UNPROCESSABLE_ENTITY, "The surfaces cannot be compared"),
        K::RegistrationFailed => (S::UNPROCESSABLE_ENTITY, "The surfaces cannot be registered"),
        K::NoReference => (S::NOT_FOUND, "There is no reference to compare with"),
        K::NotReady => (S::NOT_FOUND, "The result is not available"),
        K::ForeignOrigin => (S::FORBIDDEN, "The request comes from a page of another origin"),
        K::ForeignHost => (S::MISDIRECTED_REQUEST, "The request is for another host"),
        K::QueueFull => (S::SERVICE_UNAVAILABLE, "Too many jobs are waiting"),
        K::TenantQueueFull => (S::TOO_MANY_REQUESTS, "Too many of your jobs are waiting"),
        K::QuotaFull => (S::TOO_MANY_REQUESTS, "The session's storage quota is full"),
        K::Unauthenticated => (S::UNAUTHORIZED, "The sender is not authenticated"),
        K::Forbidden => (S::FORBIDDEN, "The sender lacks a permission"),
        K::ShuttingDown => (S::SERVICE_UNAVAILABLE, "The service is stopping"),
        K::StoreUnavailable => (S::SERVICE_UNAVAILABLE, "The database or the bucket cannot be reached"),
        K::StoreRefuses => (S::SERVICE_UNAVAILABLE, "The bucket refuses access"),
        K::StorageFull => (S::INSUFFICIENT_STORAGE, "The disk is full"),
        K::DeadlineExceeded => (S::UNPROCESSABLE_ENTITY, "The job exceeded its time limit"),
        K::JobInterrupted => (S::INTERNAL_SERVER_ERROR, "The service stopped too often while the job ran"),
        K::Internal => (S::INTERNAL_SERVER_ERROR, "The service failed"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_has_a_section_in_problems_md_and_no_section_is_left_over() {
        let text = include_str!("../../../api/problems.md");
        for kind in FaultKind::ALL {
            let (status, title) = status_and_title(*kind);
            let heading = format!("## {}\n\n{}: {title}.", kind.slug(), status.as_u16());
            assert!(text.contains(&heading), "api/problems.md lacks:\n{heading}");
        }
        let sections = text.lines().filter(|l| l.starts_with("## ")).count();
        assert_eq!(sections, FaultKind::ALL.len());
    }
}
