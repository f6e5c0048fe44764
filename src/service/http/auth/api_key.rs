use argon2::password_hash::rand_core::{OsRng, RngCore};
use argon2::password_hash::{self, PasswordHash, PasswordHasher, PasswordVerifier, SaltString};
use argon2::{Algorithm, Argon2, Params, Version};
use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;

use super::Scopes;
use prosopon_store::TenantId;

/// A static API key as configured.
///
/// The token is `ID.SECRET`; the configuration has only the secret's Argon2 hash.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ApiKey {
    /// Name of the key, with which the token starts and which the audit log shows.
    pub id: String,
    /// Tenant whose data the key gives access to.
    pub tenant: TenantId,
    /// Scopes that the key grants.
    pub scopes: Scopes,
    /// Argon2id hash of the secret, as `$argon2id$…`.
    pub hash: String,
}

impl ApiKey {
    /// Longest id of a key, bytes.
    const MAX_ID: usize = 64;

    /// All faults of the key, as messages.
    #[must_use]
    pub fn faults(&self) -> Vec<String> {
        let mut faults = Vec::new();
        let allowed = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if !(1..=Self::MAX_ID).contains(&self.id.len()) || !self.id.chars().all(allowed) {
            faults.push(format!("id `{}` must have 1 to {} letters, digits, `-` or `_`", self.id, Self::MAX_ID));
        }
        if self.scopes == Scopes::default() {
            faults.push(format!("key `{}` has no scope; give read, write or admin", self.id));
        }
        let hash = PasswordHash::new(&self.hash);
        if !hash.is_ok_and(|hash| hash.algorithm.as_str() == "argon2id" && hash.hash.is_some()) {
            faults.push(format!("the hash of key `{}` is not argon2id; make one with `prosopon auth key`", self.id));
        }
        faults
    }

    /// Whether `secret` is this key's secret. Takes some ten milliseconds of one core.
    #[must_use]
    pub(super) fn verifies(&self, secret: &str) -> bool {
        PasswordHash::new(&self.hash)
            .is_ok_and(|hash| Argon2::default().verify_password(secret.as_bytes(), &hash).is_ok())
    }
}

/// A new key: the token for the client and the hash for the configuration.
#[derive(Debug)]
pub struct NewKey {
    /// The token that the client sends, `ID.SECRET`. The service stores it nowhere.
    pub token: String,
    /// The hash for the configuration.
    pub hash: String,
}

/// Makes a key with a secret of 256 random bits.
///
/// # Errors
/// Fails if the hash cannot be computed.
pub fn new_key(id: &str) -> Result<NewKey, password_hash::Error> {
    let mut bytes = [0; 32];
    OsRng.fill_bytes(&mut bytes);
    let secret = URL_SAFE_NO_PAD.encode(bytes);
    // OWASP's parameters for passwords; a random 256-bit secret needs no more.
    let params = Params::new(19 * 1024, 2, 1, None)?;
    let argon = Argon2::new(Algorithm::Argon2id, Version::V0x13, params);
    let hash = argon.hash_password(secret.as_bytes(), &SaltString::generate(&mut OsRng))?.to_string();
    Ok(NewKey { token: format!("{id}.{secret}"), hash })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_verifies_its_own_secret_only() {
        let new = new_key("front").unwrap();
        let key =
            ApiKey { id: "front".to_owned(), tenant: TenantId::local(), scopes: Scopes::all(), hash: new.hash.clone() };
        assert_eq!(key.faults(), Vec::<String>::new());
        let (id, secret) = new.token.split_once('.').unwrap();
        assert!(id == "front" && key.verifies(secret) && !key.verifies("") && !key.verifies(&new.hash));
        assert!(!new.hash.contains(secret));
        for faulty in [
            ApiKey { id: "a.b".to_owned(), ..key.clone() },
            ApiKey { scopes: Scopes::default(), ..key.clone() },
            ApiKey { hash: secret.to_owned(), ..key.clone() },
        ] {
            assert_eq!(faulty.faults().len(), 1, "{faulty:?}");
        }
    }
}
