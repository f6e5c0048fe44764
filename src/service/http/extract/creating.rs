use axum::extract::{FromRequest, Request};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::json::{parse, read_json};
use crate::http::auth::Principal;
use crate::http::{AppState, Problem};
use prosopon_contract::FaultKind;
use prosopon_session::key_of;
use prosopon_store::{AnswerRecord, SessionId, StoredAnswer, TenantId};

const IDEMPOTENCY_KEY: &str = "idempotency-key";

/// The JSON body of a request that creates something, with its idempotency key.
///
/// A request that repeats a key with the same payload gets the stored answer and does not reach the handler.
#[derive(Debug)]
pub(in crate::http) struct CreateBody<T> {
    pub(in crate::http) body: T,
    tenant: TenantId,
    key: Option<(String, String)>,
}

impl<T: DeserializeOwned> FromRequest<AppState> for CreateBody<T> {
    type Rejection = Response;

    async fn from_request(request: Request, state: &AppState) -> Result<Self, Response> {
        let RepeatableBody { creating, earlier } =
            RepeatableBody::from_request(request, state).await.map_err(IntoResponse::into_response)?;
        match earlier {
            Some(earlier) => Err(replay(&earlier)),
            None => Ok(creating),
        }
    }
}

/// A [`CreateBody`] whose handler itself answers a repeated request, from the stored first answer.
#[derive(Debug)]
pub(in crate::http) struct RepeatableBody<T> {
    pub(in crate::http) creating: CreateBody<T>,
    pub(in crate::http) earlier: Option<AnswerRecord>,
}

impl<T: DeserializeOwned> FromRequest<AppState> for RepeatableBody<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &AppState) -> Result<Self, Problem> {
        let key = match request.headers().get(IDEMPOTENCY_KEY) {
            Some(value) => Some(checked_key(value)?),
            None => None,
        };
        let mut earlier = None;
        let tenant = request.extensions().get::<Principal>().map_or_else(TenantId::local, |p| p.tenant.clone());
        let target = format!("{} {}", request.method(), request.uri().path());
        let bytes = read_json(request, state).await?;
        let key = match key {
            Some(key) => {
                // Parsing sorts the members, so that payloads that differ in layout only have the same hash.
                let payload: Value = parse(&bytes)?;
                let sha256 = key_of(&[&target, &payload.to_string()]);
                let remembered = state.service.store().remembered(&tenant, &key, &sha256).await;
                match remembered? {
                    StoredAnswer::Nothing => {}
                    StoredAnswer::Answer(answer) => earlier = Some(answer),
                    StoredAnswer::OtherRequest => return Err(mismatch()),
                }
                Some((key, sha256))
            }
            None => None,
        };
        let body = parse(&bytes)?;
        Ok(Self { creating: CreateBody { body, tenant, key }, earlier })
    }
}

impl<T> CreateBody<T> {
    /// Splits into the body and the maker of the stored answer.
    pub(in crate::http) fn split(self) -> (T, Answering) {
        (self.body, Answering { tenant: self.tenant, key: self.key })
    }
}

/// Makes the answer that is stored with the created object for repeated requests.
#[derive(Debug)]
pub(in crate::http) struct Answering {
    tenant: TenantId,
    key: Option<(String, String)>,
}

impl Answering {
    pub(in crate::http) fn remember<T: Serialize>(
        &self,
        status: StatusCode,
        location: &str,
        retry_after: Option<&str>,
        body: &T,
        session: SessionId,
    ) -> Option<AnswerRecord> {
        let (key, request_sha256) = self.key.clone()?;
        Some(AnswerRecord {
            tenant: self.tenant.clone(),
            key,
            request_sha256,
            status: status.as_u16(),
            location: Some(location.to_owned()),
            retry_after: retry_after.map(str::to_owned),
            body: serde_json::to_string(body).unwrap_or_default(),
            session: Some(session),
        })
    }
}

fn checked_key(value: &HeaderValue) -> Result<String, Problem> {
    let key = value.to_str().unwrap_or_default();
    if (1..=200).contains(&key.len()) {
        return Ok(key.to_owned());
    }
    Err(Problem::new(FaultKind::MalformedRequest, "Idempotency-Key must be 1 to 200 ASCII characters"))
}

fn mismatch() -> Problem {
    Problem::new(FaultKind::IdempotencyMismatch, "this Idempotency-Key was used with another path or payload")
}

fn replay(answer: &AnswerRecord) -> Response {
    let status = StatusCode::from_u16(answer.status).unwrap_or(StatusCode::OK);
    let mut response = (status, [(header::CONTENT_TYPE, "application/json")], answer.body.clone()).into_response();
    let headers = response.headers_mut();
    for (name, value) in [(header::LOCATION, &answer.location), (header::RETRY_AFTER, &answer.retry_after)] {
        if let Some(value) = value.as_deref().and_then(|v| HeaderValue::from_str(v).ok()) {
            headers.insert(name, value);
        }
    }
    mark_replayed(headers);
    response
}

/// Marks an answer as that of an earlier request.
pub(in crate::http) fn mark_replayed(headers: &mut HeaderMap) {
    headers.insert("idempotency-replayed", HeaderValue::from_static("true"));
}
