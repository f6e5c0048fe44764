use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Request for a link that needs no token.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateLink {
    /// Path and query of a GET below `/v1/sessions/{session}` or `/v1/jobs/{job}`.
    #[schema(example = "/v1/jobs/019ac0de-0000-7000-8000-000000000001/steps/2/error.png")]
    pub path: String,
    /// Time for which the link is valid, s, 1 to 3600; 300 when absent. A stream goes on after it.
    #[serde(default)]
    #[schema(minimum = 1, maximum = 3600)]
    pub valid_s: Option<u32>,
}

/// A link that needs no token.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct LinkView {
    /// Path and query of the link, to be sent unchanged. Whoever has it can read this one answer.
    pub url: String,
    /// End of its validity (RFC 3339).
    pub expires_at: String,
}
