use super::{SessionId, TenantId};

/// The answer to a creating request, kept under its idempotency key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AnswerRecord {
    /// Whose key it is.
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
    /// Forgotten together with this session.
    pub session: Option<SessionId>,
}

/// What is known of an idempotency key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Remembered {
    /// Never seen.
    Nothing,
    /// The same request was answered so.
    Answer(AnswerRecord),
    /// The key was used for another request.
    OtherRequest,
}
