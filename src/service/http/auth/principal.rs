use std::convert::Infallible;
use std::fmt;
use std::str::FromStr;

use axum::extract::FromRequestParts;
use axum::http::request::Parts;

use prosopon_store::TenantId;

/// What a token allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Scope {
    /// Look at what there is.
    Read,
    /// Make, change, delete.
    Write,
    /// Metrics.
    Admin,
}

impl Scope {
    /// Every scope.
    pub const ALL: [Self; 3] = [Self::Read, Self::Write, Self::Admin];

    /// Its name.
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

/// Scopes of one token.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Scopes(Vec<Scope>);

impl Scopes {
    /// All of them.
    #[must_use]
    pub fn all() -> Self {
        Self(Scope::ALL.to_vec())
    }

    /// Those named in a list with blanks or commas; names of others, as OpenID's, are no scopes here.
    #[must_use]
    pub fn named_in(text: &str) -> Self {
        let names = text.split([' ', ',']).map(|name| name.strip_prefix("prosopon:").unwrap_or(name));
        Self(names.filter_map(|name| name.parse().ok()).collect())
    }

    /// Whether `scope` is among them.
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

/// Who sends a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Principal {
    /// Whose data they see.
    pub tenant: TenantId,
    /// Key or subject, as the audit log names them.
    pub who: String,
    /// What they may do.
    pub scopes: Scopes,
}

impl Principal {
    /// Anyone on a service without authentication.
    #[must_use]
    pub fn local() -> Self {
        Self { tenant: TenantId::local(), who: "local".to_owned(), scopes: Scopes::all() }
    }
}

impl<S: Send + Sync> FromRequestParts<S> for Principal {
    type Rejection = Infallible;

    /// The guard has put it there; without one (in tests of single routes) it is nobody, who owns nothing and may do nothing.
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
