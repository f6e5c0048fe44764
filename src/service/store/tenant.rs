use std::fmt;
use std::str::FromStr;

/// Name of a tenant, the owner of sessions, as the configuration or a token gives it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct TenantId(String);

impl TenantId {
    /// Largest length of a name, bytes.
    pub const MAX_BYTES: usize = 64;

    /// The only tenant of a service without authentication.
    #[must_use]
    pub fn local() -> Self {
        Self("local".to_owned())
    }

    /// The name.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for TenantId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl FromStr for TenantId {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-_.".contains(c);
        if (1..=Self::MAX_BYTES).contains(&text.len()) && text.chars().all(allowed) {
            return Ok(Self(text.to_owned()));
        }
        Err(format!("a tenant's name has 1 to {} characters of a-z, 0-9, `-`, `_` and `.`", Self::MAX_BYTES))
    }
}

#[cfg(test)]
mod tests {
    use super::TenantId;

    #[test]
    fn names_that_could_be_read_in_two_ways_are_refused() {
        for name in ["local", "hospital-a", "a.b_9"] {
            assert_eq!(name.parse::<TenantId>().unwrap().as_str(), name);
        }
        for name in ["", "A", "a b", "a/b", "é", &"x".repeat(65)] {
            assert!(name.parse::<TenantId>().is_err(), "{name}");
        }
    }
}
