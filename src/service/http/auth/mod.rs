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

/// Time between two looks whether the key of an open stream is still valid.
const LOOK_FOR_REVOCATION: std::time::Duration = std::time::Duration::from_secs(2);

impl Access {
    /// Whether the sender, or the one who made the sender's link, may still read.
    pub(super) fn still_admits(&self, sender: &Principal) -> bool {
        match self {
            Self::Open => sender.credential == Principal::OPEN,
            Self::Tokens(authenticator) => authenticator.may_read(&sender.credential, &sender.tenant),
        }
    }

    /// Waits until the sender may no longer read, because its API key was removed or changed.
    pub(super) async fn until_revoked(self, sender: Principal) {
        while self.still_admits(&sender) {
            tokio::time::sleep(LOOK_FOR_REVOCATION).await;
        }
    }
}
