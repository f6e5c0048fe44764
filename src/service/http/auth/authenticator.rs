use std::collections::BTreeMap;
use std::sync::{Arc, PoisonError, RwLock};

use super::api_key::hash_of;
use super::token::Tokens;
use super::{ApiKey, JwtSettings, Principal, Scope};
use prosopon_contract::{Fault, FaultKind};
use prosopon_store::TenantId;

/// Keys and identity providers whose tokens are trusted.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AuthSettings {
    /// Static API keys.
    pub keys: Vec<ApiKey>,
    /// Identity provider whose tokens (JWT) are trusted; none when `None`.
    pub jwt: Option<JwtSettings>,
}

/// Why authentication cannot be set up.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("authentication: {0}")]
pub struct AuthError(pub String);

/// Finds the sender that a bearer token names.
#[derive(Debug)]
pub struct Authenticator {
    /// The keys by the hashes of their tokens.
    keys: RwLock<BTreeMap<String, ApiKey>>,
    tokens: Option<Tokens>,
}

impl Authenticator {
    /// Reads the identity provider's public keys.
    ///
    /// # Errors
    /// Fails if the keys cannot be read, or if the settings have neither a key nor an identity provider.
    pub fn new(settings: AuthSettings) -> Result<Arc<Self>, AuthError> {
        if settings.keys.is_empty() && settings.jwt.is_none() {
            return Err(AuthError("neither a key nor an identity provider is configured".to_owned()));
        }
        let tokens = settings.jwt.map(Tokens::open).transpose().map_err(AuthError)?;
        Ok(Arc::new(Self { keys: RwLock::new(by_hash(settings.keys)), tokens }))
    }

    /// Replaces the API keys; tokens of keys that are gone are refused from now on.
    pub fn set_keys(&self, keys: Vec<ApiKey>) {
        *self.keys.write().unwrap_or_else(PoisonError::into_inner) = by_hash(keys);
    }

    /// The sender that an `Authorization` header names.
    ///
    /// # Errors
    /// [`FaultKind::Unauthenticated`]. Only the log has the reason of a refusal.
    pub fn check(&self, authorization: Option<&str>) -> Result<Principal, Fault> {
        let Some(token) = authorization.and_then(bearer) else {
            return Err(unknown("the request has no bearer token; send `Authorization: Bearer TOKEN`", "none"));
        };
        let is_key = token.bytes().filter(|b| *b == b'.').count() == 1;
        match (is_key, &self.tokens) {
            (true, _) => self.by_key(token),
            (false, Some(tokens)) => {
                tokens.check(token).map_err(|reason| unknown("the bearer token is not trusted", &reason))
            }
            (false, None) => Err(unknown("the bearer token is not trusted", "no API key, and no identity provider")),
        }
    }

    /// Whether the sender with this credential may still read what the tenant has.
    ///
    /// Tokens of an identity provider end by themselves.
    pub(super) fn may_read(&self, credential: &str, tenant: &TenantId) -> bool {
        if credential == Principal::TOKEN {
            return self.tokens.is_some();
        }
        let keys = self.keys.read().unwrap_or_else(PoisonError::into_inner);
        keys.values().any(|key| key.mark() == credential && key.tenant == *tenant && key.scopes.allow(Scope::Read))
    }

    fn by_key(&self, token: &str) -> Result<Principal, Fault> {
        let keys = self.keys.read().unwrap_or_else(PoisonError::into_inner);
        let key = keys.get(&hash_of(token)).ok_or_else(|| unknown("the bearer token is not trusted", "no such key"))?;
        Ok(Principal {
            tenant: key.tenant.clone(),
            who: format!("key:{}", key.id),
            scopes: key.scopes.clone(),
            credential: key.mark().to_owned(),
        })
    }
}

fn by_hash(keys: Vec<ApiKey>) -> BTreeMap<String, ApiKey> {
    keys.into_iter().map(|key| (key.hash.clone(), key)).collect()
}

fn bearer(authorization: &str) -> Option<&str> {
    let (scheme, token) = authorization.split_once(' ')?;
    (scheme.eq_ignore_ascii_case("bearer") && !token.is_empty()).then(|| token.trim())
}

fn unknown(detail: &str, reason: &str) -> Fault {
    metrics::counter!("prosopon_auth_refusals_total").increment(1);
    tracing::warn!(reason, "a request was refused");
    Fault::new(FaultKind::Unauthenticated, detail)
}
