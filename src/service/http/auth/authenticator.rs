use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::Semaphore;

use super::token::Tokens;
use super::{ApiKey, JwtSettings, Principal};
use prosopon_contract::{Fault, FaultKind};
use prosopon_jobs::CpuPool;
use prosopon_store::sha256_hex;

/// Secrets checked at the same time; each check takes 19 MB and some ten milliseconds.
const CHECKS_AT_ONCE: usize = 2;
/// Number of requests that can wait for or be in such a check; further ones are refused as busy.
const CHECKS_WAITING: usize = 16;
/// Number of verified tokens that are remembered.
const REMEMBERED: usize = 1024;

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
    keys: Vec<ApiKey>,
    tokens: Option<Tokens>,
    cpu: CpuPool,
    /// Key index by the SHA-256 of verified tokens, so that the slow hash is computed once per token.
    verified: Mutex<BTreeMap<String, usize>>,
    checks: Semaphore,
    waiting: Semaphore,
}

impl Authenticator {
    /// Reads the identity provider's public keys.
    ///
    /// # Errors
    /// Fails if the keys cannot be read, or if the settings have neither a key nor an identity provider.
    pub fn new(settings: AuthSettings, cpu: CpuPool) -> Result<Arc<Self>, AuthError> {
        if settings.keys.is_empty() && settings.jwt.is_none() {
            return Err(AuthError("neither a key nor an identity provider is configured".to_owned()));
        }
        let tokens = settings.jwt.map(Tokens::open).transpose().map_err(AuthError)?;
        Ok(Arc::new(Self {
            keys: settings.keys,
            tokens,
            cpu,
            verified: Mutex::default(),
            checks: Semaphore::new(CHECKS_AT_ONCE),
            waiting: Semaphore::new(CHECKS_WAITING),
        }))
    }

    /// The sender that an `Authorization` header names.
    ///
    /// # Errors
    /// [`FaultKind::Unauthenticated`] or [`FaultKind::Busy`]. Only the log has the reason of a refusal.
    pub async fn check(self: &Arc<Self>, authorization: Option<&str>) -> Result<Principal, Fault> {
        let Some(token) = authorization.and_then(bearer) else {
            return Err(unknown("the request has no bearer token; send `Authorization: Bearer TOKEN`", "none"));
        };
        let is_key = token.bytes().filter(|b| *b == b'.').count() == 1;
        match (is_key, &self.tokens) {
            (true, _) => self.by_key(token).await,
            (false, Some(tokens)) => {
                tokens.check(token).map_err(|reason| unknown("the bearer token is not trusted", &reason))
            }
            (false, None) => Err(unknown("the bearer token is not trusted", "no API key, and no identity provider")),
        }
    }

    async fn by_key(self: &Arc<Self>, token: &str) -> Result<Principal, Fault> {
        let digest = sha256_hex(token.as_bytes());
        let known = self.verified.lock().unwrap_or_else(PoisonError::into_inner).get(&digest).copied();
        let index = match known {
            Some(index) => index,
            None => self.verify(token, digest).await?,
        };
        let key = self.keys.get(index).ok_or_else(|| unknown("the bearer token is not trusted", "no such key"))?;
        Ok(Principal { tenant: key.tenant.clone(), who: format!("key:{}", key.id), scopes: key.scopes.clone() })
    }

    async fn verify(self: &Arc<Self>, token: &str, digest: String) -> Result<usize, Fault> {
        let refused = |reason: &str| unknown("the bearer token is not trusted", reason);
        let (id, secret) = token.split_once('.').unwrap_or_default();
        let index = self.keys.iter().position(|k| k.id == id).ok_or_else(|| refused("no such key"))?;
        let busy = || Fault::new(FaultKind::Busy, "too many API keys are being checked; try again");
        let _waiting = self.waiting.try_acquire().map_err(|_| busy())?;
        let _checking = self.checks.acquire().await.map_err(|_| busy())?;
        let (own, secret) = (Arc::clone(self), secret.to_owned());
        let verified = self.cpu.run_request(move || own.keys.get(index).is_some_and(|k| k.verifies(&secret))).await;
        if !verified.unwrap_or(false) {
            return Err(refused("wrong secret"));
        }
        let mut remembered = self.verified.lock().unwrap_or_else(PoisonError::into_inner);
        if remembered.len() >= REMEMBERED {
            remembered.clear();
        }
        remembered.insert(digest, index);
        Ok(index)
    }
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
