use std::time::Duration;

use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};
use time::OffsetDateTime;
use time::format_description::BorrowedFormatItem;
use time::format_description::well_known::Rfc3339;
use time::macros::format_description;

use super::StoreError;

/// The current time, RFC 3339 UTC with milliseconds.
#[must_use]
pub fn now_rfc3339() -> String {
    rfc3339(OffsetDateTime::now_utc())
}

/// The time that lies `after` later than `time` (RFC 3339); `None` when `time` cannot be parsed.
#[must_use]
pub fn later(time: &str, after: Duration) -> Option<String> {
    let time = OffsetDateTime::parse(time, &Rfc3339).ok()?;
    Some(rfc3339(time.checked_add(time::Duration::try_from(after).ok()?)?))
}

/// All times have the same length, so they sort as text.
pub fn rfc3339(time: OffsetDateTime) -> String {
    const FORM: &[BorrowedFormatItem<'_>] =
        format_description!("[year]-[month]-[day]T[hour]:[minute]:[second].[subsecond digits:3]Z");
    time.format(FORM).unwrap_or_default()
}

/// SHA-256 of `bytes`, lower-case hexadecimal.
#[must_use]
pub fn sha256_hex(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

pub(super) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

pub(super) fn to_json<T: Serialize>(what: &str, value: &T) -> Result<String, StoreError> {
    serde_json::to_string(value).map_err(|e| StoreError::record(format!("{what}: {e}")))
}

pub(super) fn from_json<T: DeserializeOwned>(what: &str, text: &str) -> Result<T, StoreError> {
    serde_json::from_str(text).map_err(|e| StoreError::record(format!("{what}: {e}")))
}

/// Ids as a JSON list, for one parameter of a query.
pub(super) fn id_list(ids: &[impl std::fmt::Display]) -> String {
    let texts: Vec<String> = ids.iter().map(ToString::to_string).collect();
    serde_json::Value::from(texts).to_string()
}

pub(super) fn parse_id<T: std::str::FromStr>(text: &str) -> Result<T, StoreError> {
    text.parse().map_err(|_| StoreError::record(format!("`{text}` is not an id")))
}

/// Byte counts and sequence numbers are signed in SQL; all of them stay far below the limit.
pub(super) fn to_i64(value: u64) -> i64 {
    i64::try_from(value).unwrap_or(i64::MAX)
}

pub(super) fn to_u64(value: i64) -> u64 {
    u64::try_from(value).unwrap_or(0)
}

pub(super) fn to_u32(value: i64) -> u32 {
    u32::try_from(value).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_later_time_is_so_much_later() {
        let later = super::later("2026-02-28T23:59:59.500Z", std::time::Duration::from_millis(500));
        assert_eq!(later.as_deref(), Some("2026-03-01T00:00:00.000Z"));
        assert_eq!(super::later("yesterday", std::time::Duration::ZERO), None);
    }

    #[test]
    fn sha256_of_the_empty_string_is_the_published_one() {
        assert_eq!(super::sha256_hex(b""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
    }

    #[test]
    fn times_have_milliseconds_and_a_z() {
        let now = super::now_rfc3339();
        assert!(now.ends_with('Z') && now.len() == 24, "{now}");
    }
}
