//! Signed links: one GET, for some minutes, without a token.
//!
//! Browsers send no `Authorization` header for `<img>`, `EventSource` and `<model-viewer>`. A cookie would serve pages of the
//! service's own origin only, and would need protection from forged writes. A link serves every allowed origin, allows
//! nothing but its one GET, and ends by itself.

use std::sync::Arc;

use axum::http::Uri;
use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use ring::hmac;
use time::OffsetDateTime;
use tokio::sync::OnceCell;

use super::random::random_word;
use prosopon_contract::{Fault, FaultKind};
use prosopon_store::Store;

/// Query parameter with the signature; it is the last one of a link.
const PARAMETER: &str = "link=";
/// Characters of the signature that name a link in the audit log.
const NAME_LENGTH: usize = 12;

/// Signs links and checks them, by a secret that all processes with the same database share.
#[derive(Debug, Clone, Default)]
pub struct Links {
    key: Arc<OnceCell<hmac::Key>>,
}

/// A link that was checked: its request without the signature, and its name in the audit log.
#[derive(Debug)]
pub(in crate::http) struct CheckedLink {
    pub(in crate::http) uri: Uri,
    pub(in crate::http) name: String,
    /// Credential of the sender who made the link.
    pub(in crate::http) maker: String,
}

/// A link and its name in the audit log.
#[derive(Debug)]
pub(in crate::http) struct NewLink {
    pub(in crate::http) url: String,
    pub(in crate::http) name: String,
}

impl Links {
    /// Signs `target`, a path with its query, until `expires`, for the sender with the credential `maker`.
    ///
    /// # Errors
    /// The store's.
    pub(in crate::http) async fn sign(
        &self,
        store: &Store,
        target: &str,
        expires: OffsetDateTime,
        maker: &str,
    ) -> Result<NewLink, Fault> {
        let expires = expires.unix_timestamp();
        let signature = hmac::sign(self.key(store).await?, message(expires, maker, target).as_bytes());
        let signature = URL_SAFE_NO_PAD.encode(signature);
        let joint = if target.contains('?') { '&' } else { '?' };
        let url = format!("{target}{joint}{PARAMETER}{expires}.{maker}.{signature}");
        Ok(NewLink { url, name: name_of(&signature) })
    }

    /// The link that `uri` is; `None` when it has no signature.
    ///
    /// # Errors
    /// [`FaultKind::Unauthenticated`] for a link that was changed or has expired; the store's.
    pub(in crate::http) async fn check(&self, store: &Store, uri: &Uri) -> Result<Option<CheckedLink>, Fault> {
        let Some((target, expires, maker, signature)) = parts(uri) else { return Ok(None) };
        let key = self.key(store).await?;
        let is_signed = URL_SAFE_NO_PAD
            .decode(signature)
            .is_ok_and(|tag| hmac::verify(key, message(expires, maker, &target).as_bytes(), &tag).is_ok());
        let refused = |detail: &str| Err(Fault::new(FaultKind::Unauthenticated, detail));
        if !is_signed {
            return refused(
                "the link was changed or is not one of this service; ask for a new one with POST /v1/links",
            );
        }
        if expires <= OffsetDateTime::now_utc().unix_timestamp() {
            return refused("the link has expired; ask for a new one with POST /v1/links");
        }
        let uri = target.parse().map_err(|_| Fault::new(FaultKind::MalformedRequest, "the link cannot be read"))?;
        Ok(Some(CheckedLink { uri, name: name_of(signature), maker: maker.to_owned() }))
    }

    async fn key(&self, store: &Store) -> Result<&hmac::Key, Fault> {
        let made = self.key.get_or_try_init(|| async {
            let fresh = random_word().map_err(|error| Fault::new(FaultKind::Internal, error.to_string()))?;
            let secret = store.link_key(&fresh).await?;
            Ok::<_, Fault>(hmac::Key::new(hmac::HMAC_SHA256, secret.as_bytes()))
        });
        made.await
    }
}

/// Path and query without the signature, the end of validity (s since 1970), the maker and the signature.
fn parts(uri: &Uri) -> Option<(String, i64, &str, &str)> {
    let (others, link) = match uri.query()?.rsplit_once('&') {
        Some((others, last)) => (Some(others), last),
        None => (None, uri.query()?),
    };
    let (expires, rest) = link.strip_prefix(PARAMETER)?.split_once('.')?;
    let (maker, signature) = rest.split_once('.')?;
    let target = others.map_or_else(|| uri.path().to_owned(), |others| format!("{}?{others}", uri.path()));
    Some((target, expires.parse().ok()?, maker, signature))
}

fn message(expires: i64, maker: &str, target: &str) -> String {
    format!("GET {expires} {maker} {target}")
}

fn name_of(signature: &str) -> String {
    signature.chars().take(NAME_LENGTH).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_signature_is_the_last_parameter() {
        let of = |uri: &str| parts(&uri.parse().unwrap()).map(|(target, t, m, s)| format!("{target} {t} {m} {s}"));
        assert_eq!(of("/a?link=7.key.sig"), Some("/a 7 key sig".to_owned()));
        assert_eq!(of("/a?b=c&link=7..sig"), Some("/a?b=c 7  sig".to_owned()));
        assert_eq!(of("/a?link=7.key.sig&b=c"), None);
        assert_eq!(of("/a?link=7.sig"), None);
        assert_eq!(of("/a?link=sig"), None);
        assert_eq!(of("/a"), None);
    }
}
