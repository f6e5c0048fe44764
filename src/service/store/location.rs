use std::fmt;
use std::path::Path as FsPath;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;

use futures::future::LocalBoxFuture;
use object_store::aws::AmazonS3Builder;
use object_store::path::Path;
use object_store::prefix::PrefixStore;
use object_store::{BackoffConfig, ObjectStore, RetryConfig};
use sqlx::postgres::PgConnectOptions;

use super::{Keyring, StoreError, postgres};

/// Where a store keeps rows and blobs (`None` means in the data directory), and how.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StoreLocation {
    /// Database of the rows.
    pub database: Option<DatabaseUrl>,
    /// Bucket of the blobs.
    pub blobs: Option<BucketUrl>,
    /// Keys of the blobs; with none they are stored as they are.
    pub keys: Keyring,
}

impl StoreLocation {
    /// Whether rows and blobs are in the data directory.
    pub(super) fn is_local(&self) -> bool {
        self.database.is_none() && self.blobs.is_none()
    }

    /// Description for messages, without the password.
    #[must_use]
    pub fn with_directory(&self, data: &FsPath) -> String {
        let mut text = format!("the data directory {}", data.display());
        if let Some(database) = &self.database {
            text = format!("{text} with {database}");
        }
        if let Some(blobs) = &self.blobs {
            text = format!("{text} and {blobs}");
        }
        text
    }
}

/// Address of a Postgres database: `postgres://user:password@host:port/name?sslmode=…`.
///
/// `Display` and `Debug` omit the password.
#[derive(Clone)]
pub struct DatabaseUrl {
    shown: String,
    options: PgConnectOptions,
}

/// Parameters that the address of a database may have.
const PARAMETERS: &[&str] = &[
    "sslmode",
    "sslrootcert",
    "sslcert",
    "sslkey",
    "host",
    "port",
    "dbname",
    "user",
    "password",
    "application_name",
    "options",
    "statement-cache-capacity",
];

impl DatabaseUrl {
    pub(super) fn options(&self) -> &PgConnectOptions {
        &self.options
    }

    /// Migrates the database to the current format, one process at a time.
    ///
    /// Returns the format found (0 for an empty database) and the current one.
    ///
    /// # Errors
    /// [`StoreError::Newer`], [`StoreError::ForeignTables`], [`StoreError::Unreachable`].
    pub fn migrate(&self) -> LocalBoxFuture<'_, Result<(i64, i64), StoreError>> {
        Box::pin(postgres::migrate(&self.options))
    }
}

impl FromStr for DatabaseUrl {
    type Err = String;

    /// The error does not quote the address, which may hold a password.
    fn from_str(text: &str) -> Result<Self, String> {
        const EXPECTED: &str = "is not an address of the form postgres://user:password@host:5432/name";
        let is_postgres = |scheme: &str| matches!(scheme, "postgres" | "postgresql");
        let (scheme, rest) = text.split_once("://").filter(|(s, _)| is_postgres(s)).ok_or(EXPECTED)?;
        let (place, query) = rest.split_once('?').unwrap_or((rest, ""));
        let (authority, name) = place.split_once('/').unwrap_or((place, ""));
        if name.contains(['@', ':']) || rest.contains('#') {
            return Err(format!("{EXPECTED}; in a password write `/` as %2F, `?` as %3F, `#` as %23 and `@` as %40"));
        }
        let parameters: Vec<(&str, &str)> =
            query.split('&').filter(|p| !p.is_empty()).map(|p| p.split_once('=').unwrap_or((p, ""))).collect();
        if parameters.iter().any(|(key, _)| !PARAMETERS.contains(key)) {
            return Err(format!("has an unknown parameter; the known ones are {}", PARAMETERS.join(", ")));
        }
        let options: PgConnectOptions = text.parse().map_err(|_| EXPECTED)?;
        if options.get_database().is_none() {
            return Err("names no database; end the address with `/` and the name of the database".to_owned());
        }
        let (user, host) = authority.rsplit_once('@').unwrap_or(("", authority));
        let user = user.split(':').next().filter(|u| !u.is_empty()).map(|u| format!("{u}@")).unwrap_or_default();
        let mut shown = format!("{scheme}://{user}{host}/{name}");
        for (index, (key, value)) in parameters.iter().filter(|(key, _)| *key != "password").enumerate() {
            shown.push_str(&format!("{}{key}={value}", if index == 0 { '?' } else { '&' }));
        }
        let options = match options.get_application_name() {
            Some(_) => options,
            None => options.application_name("prosopon"),
        };
        Ok(Self { shown, options })
    }
}

impl fmt::Display for DatabaseUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.shown)
    }
}

impl fmt::Debug for DatabaseUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.shown)
    }
}

impl PartialEq for DatabaseUrl {
    fn eq(&self, other: &Self) -> bool {
        self.shown == other.shown
    }
}

/// Address of a bucket of an S3-compatible store, with an optional prefix: `s3://bucket/prefix`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BucketUrl {
    bucket: String,
    prefix: Path,
}

impl BucketUrl {
    /// Opens the bucket with the endpoint, region and credentials of the environment.
    ///
    /// It reads `AWS_ENDPOINT_URL`, `AWS_REGION`, `AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY` and the other `AWS_` variables.
    ///
    /// # Errors
    /// [`StoreError::Bucket`] when the settings are incomplete or contradict each other.
    pub fn open(&self) -> Result<Arc<dyn ObjectStore>, StoreError> {
        self.open_with(AmazonS3Builder::from_env())
    }

    /// Opens the bucket with the endpoint, region and credentials of `client`.
    ///
    /// # Errors
    /// [`StoreError::Bucket`] when the settings are incomplete or contradict each other.
    pub fn open_with(&self, client: AmazonS3Builder) -> Result<Arc<dyn ObjectStore>, StoreError> {
        // The client's TLS uses the process's provider; for the second bucket it is installed already.
        rustls::crypto::ring::default_provider().install_default().ok();
        let bucket =
            client.with_bucket_name(&self.bucket).with_retry(patience()).build().map_err(StoreError::Bucket)?;
        if self.prefix.is_root() {
            return Ok(Arc::new(bucket));
        }
        Ok(Arc::new(PrefixStore::new(bucket, self.prefix.clone())))
    }
}

/// Retries of requests to a bucket: for one minute.
///
/// `max_retries` is so large that only the time limits them. With the library's ten retries and three minutes, the retries
/// would be used up after four seconds.
fn patience() -> RetryConfig {
    let backoff = BackoffConfig { max_backoff: Duration::from_secs(5), ..BackoffConfig::default() };
    RetryConfig { backoff, max_retries: 1000, retry_timeout: Duration::from_secs(60) }
}

impl FromStr for BucketUrl {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let expected = || format!("`{text}` is not an address of the form s3://bucket or s3://bucket/prefix");
        let (bucket, prefix) =
            text.strip_prefix("s3://").map(|t| t.split_once('/').unwrap_or((t, ""))).ok_or_else(expected)?;
        let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-.".contains(c);
        if !(3..=63).contains(&bucket.len()) || !bucket.chars().all(allowed) || prefix.starts_with('/') {
            return Err(expected());
        }
        let prefix = Path::parse(prefix.trim_end_matches('/')).map_err(|_| expected())?;
        Ok(Self { bucket: bucket.to_owned(), prefix })
    }
}

impl fmt::Display for BucketUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "s3://{}", self.bucket)?;
        if self.prefix.is_root() { Ok(()) } else { write!(f, "/{}", self.prefix) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_of_a_database_is_shown_without_its_password() {
        let shown = |text: &str| text.parse::<DatabaseUrl>().map(|url| format!("{url} {url:?}"));
        let address = "postgres://anna:se%2Fcret@db.example:5433/plans?sslmode=require&password=secret2";
        let expected = "postgres://anna@db.example:5433/plans?sslmode=require";
        assert_eq!(shown(address), Ok(format!("{expected} {expected}")));
        assert_eq!(expected.parse::<DatabaseUrl>().unwrap().to_string(), expected, "what is shown can be read");
        for faulty in [
            "",
            "plans",
            "mysql://anna:secret@h/plans",
            "postgres://anna:secret@h",
            "postgres://anna:12/secret@h/plans",
            "postgres://anna:secret#x@h/plans",
            "postgres://anna:secret?x@h/plans",
            "postgres://anna:secret@h:none/plans",
            "postgres://h/plans?passwd=secret",
            "postgres://h/plans?sslmode=secret",
        ] {
            let fault = shown(faulty).unwrap_err();
            assert!(!fault.contains("secret"), "{faulty}: {fault}");
        }
    }

    #[test]
    fn an_address_of_a_bucket_has_a_name_and_perhaps_a_prefix() {
        for fine in ["s3://plans", "s3://plans/a", "s3://plans.example/a/b"] {
            assert_eq!(fine.parse::<BucketUrl>().unwrap().to_string(), fine);
        }
        assert_eq!("s3://plans/a/".parse::<BucketUrl>().unwrap().to_string(), "s3://plans/a");
        for faulty in ["", "plans", "s3://", "s3://ab", "s3://Plans", "s3://a b c", "s3://plans//a", "https://plans"] {
            assert!(faulty.parse::<BucketUrl>().is_err(), "{faulty}");
        }
    }
}
