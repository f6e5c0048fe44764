use std::convert::Infallible;
use std::fmt;
use std::str::FromStr;

use axum::extract::FromRequestParts;
use axum::http::request::Parts;

use prosopon_store::TenantId;

/// A permission that a token grants.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Scope {
    /// Read sessions, jobs and results.
    Read,
    /// Create, change and delete.
    Write,
    /// Read the metrics.
    Admin,
}

impl Scope {
    /// All scopes.
    pub const ALL: [Self; 3] = [Self::Read, Self::Write, Self::Admin];

    /// Name of the scope.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Write => "write",
            Self::Admin => "admin",
        }
    }
}

impl FromStr for Scope {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|s| s.as_str() == text)
            .ok_or_else(|| format!("`{text}` is not read, write or admin"))
    }
}

/// The scopes of one token.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Scopes(Vec<Scope>);

impl Scopes {
    /// The set of all scopes.
    #[must_use]
    pub fn all() -> Self {
        Self(Scope::ALL.to_vec())
    }

    /// The scopes named in a list separated by blanks or commas.
    ///
    /// Other names, such as those of OpenID, are ignored.
    #[must_use]
    pub fn named_in(text: &str) -> Self {
        let names = text.split([' ', ',']).map(|name| name.strip_prefix("prosopon:").unwrap_or(name));
        Self(names.filter_map(|name| name.parse().ok()).collect())
    }

    /// Whether the set contains `scope`.
    #[must_use]
    pub fn allow(&self, scope: Scope) -> bool {
        self.0.contains(&scope)
    }
}

impl FromIterator<Scope> for Scopes {
    fn from_iter<T: IntoIterator<Item = Scope>>(scopes: T) -> Self {
        Self(scopes.into_iter().collect())
    }
}

impl fmt::Display for Scopes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<&str> = self.0.iter().map(|s| s.as_str()).collect();
        f.write_str(&names.join(" "))
    }
}

/// The sender of a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Principal {
    /// Tenant whose data the sender can access.
    pub tenant: TenantId,
    /// Key or subject, as named in the audit log.
    pub who: String,
    /// Scopes of the sender.
    pub scopes: Scopes,
    /// What admits the sender, or admitted the one who made the sender's link: the mark of an API key, [`Self::TOKEN`] or
    /// [`Self::OPEN`].
    pub credential: String,
}

impl Principal {
    /// Credential of a sender with a token of the identity provider.
    pub const TOKEN: &str = "token";
    /// Credential of everybody where there is no authentication.
    pub const OPEN: &str = "open";

    /// The sender of every request to a service without authentication.
    #[must_use]
    pub fn local() -> Self {
        let (tenant, who) = (TenantId::local(), "local".to_owned());
        Self { tenant, who, scopes: Scopes::all(), credential: Self::OPEN.to_owned() }
    }
}

impl<S: Send + Sync> FromRequestParts<S> for Principal {
    type Rejection = Infallible;

    /// Takes the sender that the guard stored.
    ///
    /// Without a guard, as in tests of single routes, the sender has no scope.
    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        Ok(parts
            .extensions
            .get::<Self>()
            .cloned()
            .unwrap_or_else(|| Self { scopes: Scopes::default(), ..Self::local() }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scopes_are_those_named_and_no_others() {
        let scopes = Scopes::named_in("openid prosopon:read write,administrator");
        assert!(scopes.allow(Scope::Read) && scopes.allow(Scope::Write) && !scopes.allow(Scope::Admin));
        assert_eq!(Scopes::named_in(""), Scopes::default());
        assert_eq!(scopes.to_string(), "read write");
    }
}
