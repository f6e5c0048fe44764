//! Authentication and authorisation: who sends a request, and what the sender is allowed to do.

mod api_key;
mod authenticator;
mod link;
mod principal;
mod random;
mod ring_verifier;
mod token;

pub use api_key::{ApiKey, NewKey, new_key};
pub use authenticator::{AuthError, AuthSettings, Authenticator};
pub(super) use link::CheckedLink;
pub use link::Links;
pub use principal::{Principal, Scope, Scopes};
pub use random::NoRandomNumbers;
pub use token::JwtSettings;

/// Whether requests need a bearer token.
#[derive(Debug, Clone, Default)]
pub enum Access {
    /// No authentication: every request acts as the tenant `local` with all scopes. Only for loopback.
    #[default]
    Open,
    /// Requests need a bearer token that the authenticator accepts.
    Tokens(std::sync::Arc<Authenticator>),
}
