use super::{SessionId, TenantId};

/// The answer to a request that creates something, stored under its idempotency key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AnswerRecord {
    /// Tenant of the key.
    pub tenant: TenantId,
    /// The client's key.
    pub key: String,
    /// SHA-256 of method, path and payload.
    pub request_sha256: String,
    /// HTTP status.
    pub status: u16,
    /// `Location` header.
    pub location: Option<String>,
    /// `Retry-After` header.
    pub retry_after: Option<String>,
    /// Body, JSON.
    pub body: String,
    /// Session with which the answer is deleted.
    pub session: Option<SessionId>,
}

/// The stored answer to an idempotency key, if any.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StoredAnswer {
    /// The key was not used, or its answer has expired.
    Nothing,
    /// The same request got this answer.
    Answer(AnswerRecord),
    /// The key was used for another request.
    OtherRequest,
}
