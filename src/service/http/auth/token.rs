use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use jsonwebtoken::jwk::{Jwk, JwkSet};
use jsonwebtoken::{DecodingKey, Validation, decode, decode_header};
use serde_json::{Map, Value};

use super::ring_verifier::{self, ALGORITHMS};
use super::{Principal, Scopes};
use prosopon_store::TenantId;

/// Settings for checking tokens (JWT) of an identity provider.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct JwtSettings {
    /// Required value of the claim `iss`.
    pub issuer: String,
    /// Required value of the claim `aud`.
    pub audience: String,
    /// File with the provider's public keys (JWKS); the service reads it again when it changes.
    pub jwks_file: PathBuf,
    /// Name of the claim with the tenant.
    pub tenant_claim: String,
    /// Name of the claim with the scopes: a text with blanks, or a list.
    pub scope_claim: String,
    /// Largest accepted difference between the clocks.
    pub leeway: Duration,
}

impl JwtSettings {
    /// All faults of the settings, each as `NAME: fault`.
    #[must_use]
    pub fn faults(&self) -> Vec<String> {
        let texts = [
            ("issuer", &self.issuer),
            ("audience", &self.audience),
            ("tenant_claim", &self.tenant_claim),
            ("scope_claim", &self.scope_claim),
        ];
        let empty = texts.into_iter().filter(|(_, text)| text.trim().is_empty());
        let mut faults: Vec<String> = empty.map(|(name, _)| format!("{name}: must not be empty")).collect();
        faults.extend(read(self).err().map(|fault| format!("jwks_file: {fault}")));
        faults
    }
}

/// Shortest time between two checks whether the file has changed.
const LOOK_EVERY: Duration = Duration::from_secs(10);

/// Checks tokens with the provider's keys.
#[derive(Debug)]
pub(super) struct Tokens {
    settings: JwtSettings,
    keys: Mutex<Keys>,
}

#[derive(Debug)]
struct Keys {
    set: JwkSet,
    changed: Option<SystemTime>,
    looked: Instant,
}

impl Tokens {
    /// Reads the provider's keys.
    pub(super) fn open(settings: JwtSettings) -> Result<Self, String> {
        ring_verifier::install();
        let (set, changed) = read(&settings)?;
        Ok(Self { settings, keys: Mutex::new(Keys { set, changed, looked: Instant::now() }) })
    }

    /// The sender that a token names. The error is the reason of the refusal, for the log.
    pub(super) fn check(&self, token: &str) -> Result<Principal, String> {
        let header = decode_header(token).map_err(|e| e.to_string())?;
        if !ALGORITHMS.contains(&header.alg) {
            return Err(format!("algorithm {:?}", header.alg));
        }
        // RFC 7515, 4.1.11: extensions that must be understood, of which this service knows none.
        if let Some(extensions) = header.crit {
            return Err(format!("critical extensions {extensions:?}"));
        }
        let jwk = self.key(header.kid.as_deref())?;
        let key = DecodingKey::from_jwk(&jwk).map_err(|e| e.to_string())?;
        let mut validation = Validation::new(header.alg);
        validation.leeway = self.settings.leeway.as_secs();
        validation.validate_nbf = true;
        validation.set_issuer(&[&self.settings.issuer]);
        validation.set_audience(&[&self.settings.audience]);
        validation.set_required_spec_claims(&["exp", "iss", "aud", "sub"]);
        let claims = decode::<Map<String, Value>>(token, &key, &validation).map_err(|e| e.to_string())?.claims;
        self.principal(&claims)
    }

    fn principal(&self, claims: &Map<String, Value>) -> Result<Principal, String> {
        let text = |name: &str| claims.get(name).and_then(Value::as_str);
        let tenant = text(&self.settings.tenant_claim).ok_or("no tenant claim")?.parse::<TenantId>()?;
        let scopes = match claims.get(&self.settings.scope_claim) {
            Some(Value::String(names)) => Scopes::named_in(names),
            Some(Value::Array(names)) => {
                let names: Vec<&str> = names.iter().filter_map(Value::as_str).collect();
                Scopes::named_in(&names.join(" "))
            }
            _ => Scopes::default(),
        };
        // A subject can be any text; the audit log needs one short word without special characters.
        let subject = text("sub").ok_or("no subject")?;
        let harmless = |c: &char| c.is_ascii_alphanumeric() || "-_.@|:".contains(*c);
        let who: String = subject.chars().filter(harmless).take(100).collect();
        Ok(Principal { tenant, who: format!("jwt:{who}"), scopes, credential: Principal::TOKEN.to_owned() })
    }

    /// The key that a token names, or the only key if it names none.
    fn key(&self, kid: Option<&str>) -> Result<Jwk, String> {
        let mut keys = self.keys.lock().unwrap_or_else(PoisonError::into_inner);
        keys.refresh(&self.settings);
        let found = match (kid, keys.set.keys.as_slice()) {
            (Some(kid), _) => keys.set.find(kid),
            (None, [only]) => Some(only),
            (None, _) => None,
        };
        found.cloned().ok_or_else(|| "no such key".to_owned())
    }
}

impl Keys {
    fn refresh(&mut self, settings: &JwtSettings) {
        if self.looked.elapsed() < LOOK_EVERY {
            return;
        }
        self.looked = Instant::now();
        let changed = std::fs::metadata(&settings.jwks_file).and_then(|m| m.modified()).ok();
        if changed == self.changed {
            return;
        }
        match read(settings) {
            Ok((set, changed)) => {
                tracing::info!(keys = set.keys.len(), "the provider's keys were read again");
                (self.set, self.changed) = (set, changed);
            }
            Err(error) => tracing::error!(error, "the provider's keys cannot be read; the old ones stay in use"),
        }
    }
}

fn read(settings: &JwtSettings) -> Result<(JwkSet, Option<SystemTime>), String> {
    let file = &settings.jwks_file;
    let fault = |e: &dyn std::fmt::Display| format!("{} cannot be read: {e}", file.display());
    let changed = std::fs::metadata(file).and_then(|m| m.modified()).ok();
    let bytes = std::fs::read(file).map_err(|e| fault(&e))?;
    let set: JwkSet = serde_json::from_slice(&bytes).map_err(|e| fault(&e))?;
    if set.keys.is_empty() { Err(fault(&"it contains no key")) } else { Ok((set, changed)) }
}
