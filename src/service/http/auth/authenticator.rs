use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::Semaphore;

use super::token::Tokens;
use super::{ApiKey, JwtSettings, Principal};
use prosopon_jobs::CpuPool;
use prosopon_session::{Fault, FaultKind};
use prosopon_store::sha256_hex;

/// Secrets that are checked at the same time: each takes 19 MB and some ten milliseconds.
const CHECKS_AT_ONCE: usize = 2;
/// Requests that may wait for that.
const CHECKS_WAITING: usize = 16;
/// Verified tokens that are remembered.
const REMEMBERED: usize = 1024;

/// Whose tokens are trusted.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AuthSettings {
    /// Static keys.
    pub keys: Vec<ApiKey>,
    /// Tokens of an identity provider.
    pub jwt: Option<JwtSettings>,
}

/// Why authentication cannot be set up.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("authentication: {0}")]
pub struct AuthError(pub String);

/// Tells whom a bearer token names.
#[derive(Debug)]
pub struct Authenticator {
    keys: Vec<ApiKey>,
    tokens: Option<Tokens>,
    cpu: CpuPool,
    /// Index of the key by the SHA-256 of tokens that were verified: the slow hash is taken once.
    verified: Mutex<BTreeMap<String, usize>>,
    checks: Semaphore,
    waiting: Semaphore,
}

impl Authenticator {
    /// Reads the identity provider's keys.
    ///
    /// # Errors
    /// When they cannot be read, or nobody would be trusted.
    pub fn new(settings: AuthSettings, cpu: CpuPool) -> Result<Arc<Self>, AuthError> {
        if settings.keys.is_empty() && settings.jwt.is_none() {
            return Err(AuthError("there is neither a key nor an identity provider".to_owned()));
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

    /// Whom an `Authorization` header names.
    ///
    /// # Errors
    /// [`FaultKind::Unauthenticated`], [`FaultKind::Busy`]. Why is told in the log only.
    pub async fn check(self: &Arc<Self>, authorization: Option<&str>) -> Result<Principal, Fault> {
        let Some(token) = authorization.and_then(bearer) else {
            return Err(unknown("the request has no bearer token", "none"));
        };
        let is_key = token.bytes().filter(|b| *b == b'.').count() == 1;
        match (is_key, &self.tokens) {
            (true, _) => self.by_key(token).await,
            (false, Some(tokens)) => {
                tokens.check(token).map_err(|reason| unknown("the bearer token is not trusted", &reason))
            }
            (false, None) => Err(unknown("the bearer token is not trusted", "neither a key nor are others configured")),
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
        let busy = || Fault::new(FaultKind::Busy, "too many keys are being checked; try again");
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
    tracing::warn!(reason, "a request was not let in");
    Fault::new(FaultKind::Unauthenticated, detail)
}
