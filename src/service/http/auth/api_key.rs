use super::random::{NoRandomNumbers, random_word};

use super::Scopes;
use prosopon_store::{TenantId, sha256_hex};

/// Begin of the hash of a key.
const HASH: &str = "sha256:";

/// A static API key as configured.
///
/// The token is `ID.SECRET`; the configuration has only its hash. The secret is 256 random bits, which no search finds, so a fast
/// hash protects it as well as a slow one for passwords. A slow one would tell which ids exist by the time that it takes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ApiKey {
    /// Name of the key, with which the token starts and which the audit log shows.
    pub id: String,
    /// Tenant whose data the key gives access to.
    pub tenant: TenantId,
    /// Scopes that the key grants.
    pub scopes: Scopes,
    /// SHA-256 of the token: `sha256:` and 64 hexadecimal digits in lower case.
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
        let digits = self.hash.strip_prefix(HASH).unwrap_or_default();
        if digits.len() != 64 || !digits.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f')) {
            faults.push(format!(
                "the hash of key `{}` is not {HASH} and 64 digits; make a new key with `prosopon auth key`",
                self.id
            ));
        }
        faults
    }

    /// What tells the key from all others: the first digits of its hash.
    pub(super) fn mark(&self) -> &str {
        self.hash.strip_prefix(HASH).and_then(|digits| digits.get(..16)).unwrap_or_default()
    }
}

/// Hash of a token, as in the configuration.
pub(super) fn hash_of(token: &str) -> String {
    format!("{HASH}{}", sha256_hex(token.as_bytes()))
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
/// Fails if the system gives no random numbers.
pub fn new_key(id: &str) -> Result<NewKey, NoRandomNumbers> {
    let token = format!("{id}.{}", random_word()?);
    let hash = hash_of(&token);
    Ok(NewKey { token, hash })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_key_has_the_hash_of_its_token() {
        let new = new_key("front").unwrap();
        let key =
            ApiKey { id: "front".to_owned(), tenant: TenantId::local(), scopes: Scopes::all(), hash: new.hash.clone() };
        assert_eq!(key.faults(), Vec::<String>::new());
        let (id, secret) = new.token.split_once('.').unwrap();
        assert!(id == "front" && hash_of(&new.token) == key.hash && hash_of(secret) != key.hash);
        assert_ne!(new_key("front").unwrap().token, new.token);
        for faulty in [
            ApiKey { id: "a.b".to_owned(), ..key.clone() },
            ApiKey { scopes: Scopes::default(), ..key.clone() },
            ApiKey { hash: secret.to_owned(), ..key.clone() },
            ApiKey { hash: key.hash.to_uppercase(), ..key.clone() },
            ApiKey { hash: "$argon2id$v=19$m=19456,t=2,p=1$c2FsdA$aGFzaA".to_owned(), ..key.clone() },
        ] {
            assert_eq!(faulty.faults().len(), 1, "{faulty:?}");
        }
    }
}
