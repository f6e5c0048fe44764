//! Who sends a request, and what they may do.

mod api_key;
mod authenticator;
mod principal;
mod ring_verifier;
mod token;

pub use api_key::{ApiKey, NewKey, new_key};
pub use authenticator::{AuthError, AuthSettings, Authenticator};
pub use principal::{Principal, Scope, Scopes};
pub use token::JwtSettings;

/// Whether requests must say who sends them.
#[derive(Debug, Clone, Default)]
pub enum Access {
    /// Anyone who can connect may do everything, as the tenant `local`: for loopback.
    #[default]
    Open,
    /// Bearer tokens only.
    Tokens(std::sync::Arc<Authenticator>),
}
