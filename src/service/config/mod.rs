//! Configuration of the service, from defaults, a TOML file, `PROSOPON_…` variables and flags.
//!
//! Later sources override earlier ones. The configuration is checked once at start, and all faults are reported together.

mod log;
mod otlp;
mod read;
mod source;
mod tls;

use std::collections::BTreeMap;
use std::net::{SocketAddr, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::time::Duration;

pub use figment::value::Value;

use crate::http::HttpLimits;
use crate::http::auth::{ApiKey, AuthSettings};
use prosopon_contract::chain;
use prosopon_jobs::ServiceSettings;
use prosopon_store::{BucketUrl, Keyring, StoreLocation};

/// PEM files of the TLS certificate chain and private key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TlsFiles {
    /// File of the certificate chain, the service's own certificate first.
    pub cert: PathBuf,
    /// File of the private key.
    pub key: PathBuf,
}

/// Limits of connections.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConnectionLimits {
    /// Largest number of connections at the same time.
    pub most: usize,
    /// Longest time until the head of a request has arrived.
    pub head: Duration,
    /// Longest time for which a client can accept no data of an answer.
    pub stalled: Duration,
}

impl Default for ConnectionLimits {
    fn default() -> Self {
        Self { most: 1024, head: Duration::from_secs(10), stalled: Duration::from_secs(60) }
    }
}

/// Format of the log.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LogFormat {
    /// Text on a terminal, JSON otherwise.
    #[default]
    Auto,
    /// Plain text.
    Text,
    /// One JSON object per line.
    Json,
}

/// Configuration of `prosopon serve`.
#[derive(Debug, Clone, PartialEq)]
pub struct ServeConfig {
    /// Address to listen on; port 0 picks a free port. Addresses other than loopback need authentication.
    pub listen: SocketAddr,
    /// Data directory with sessions, results and the audit log.
    pub data: PathBuf,
    /// Database and bucket for sessions and results, instead of the data directory.
    pub places: StoreLocation,
    /// Whether this process serves the API.
    ///
    /// If not, it computes jobs for API processes on the same database.
    pub api: bool,
    /// Number of threads for numerics; 0 means one per core.
    pub threads: usize,
    /// Size of the cache of fields, meshes and equations between jobs, bytes.
    pub cache_bytes: u64,
    /// Host names, besides loopback, that the Host header can name, such as a proxy's.
    pub allowed_hosts: Vec<String>,
    /// Origins whose pages can use the service (CORS).
    pub origins: Vec<String>,
    /// Limits of requests.
    pub limits: HttpLimits,
    /// Limits of connections.
    pub connections: ConnectionLimits,
    /// Limits of jobs and of the contents of uploads.
    pub service: ServiceSettings,
    /// Keys and identity providers whose tokens are trusted; `None` turns authentication off.
    pub auth: Option<AuthSettings>,
    /// TLS certificate and key; plain HTTP when `None`.
    pub tls: Option<TlsFiles>,
    /// Longest wait for running jobs when the service stops.
    ///
    /// Then they are interrupted, and the next start resumes them.
    pub drain: Duration,
    /// Log level, or a filter such as `info,sqlx=warn`.
    pub log_level: String,
    /// Format of the log.
    pub log_format: LogFormat,
    /// Base address of an OpenTelemetry collector for spans (OTLP over HTTP); no spans when `None`.
    pub otlp_endpoint: Option<String>,
    /// Where it was read; `None` without a file.
    pub source: Option<ConfigSource>,
}

/// File and flags of a configuration, so that its keys can be read again.
#[derive(Debug, Clone, PartialEq)]
pub struct ConfigSource {
    /// The TOML file.
    pub file: PathBuf,
    /// Flags, which override the file.
    pub flags: BTreeMap<&'static str, Value>,
}

impl ConfigSource {
    /// The API keys as the file has them now; none when it has no `[auth]`.
    ///
    /// # Errors
    /// [`ConfigError`] with one line per fault of the file or of a key.
    pub fn keys(&self) -> Result<Vec<ApiKey>, ConfigError> {
        read::keys(&self.file, &self.flags)
    }
}

/// The keys of blobs and backups in a configuration file, if one is named, and in the environment.
///
/// # Errors
/// [`ConfigError`] with one line per fault of the file or of a key.
pub fn encryption_keys(file: Option<&Path>) -> Result<Keyring, ConfigError> {
    read::encryption(file)
}

impl ServeConfig {
    /// Default configuration for a data directory, on a free loopback port.
    #[must_use]
    pub fn new(data: PathBuf) -> Self {
        Self {
            listen: SocketAddr::from(([127, 0, 0, 1], 0)),
            data,
            places: StoreLocation::default(),
            api: true,
            threads: 0,
            cache_bytes: 1536 << 20,
            allowed_hosts: Vec::new(),
            origins: Vec::new(),
            limits: HttpLimits::default(),
            connections: ConnectionLimits::default(),
            service: ServiceSettings::default(),
            auth: None,
            tls: None,
            drain: Duration::from_secs(5),
            log_level: "info,sqlx=warn".to_owned(),
            log_format: LogFormat::Auto,
            otlp_endpoint: None,
            source: None,
        }
    }

    /// Reads a TOML file if one is named, the environment, and `flags`, whose keys are paths of settings.
    ///
    /// Returns the configuration and its printed form, without hashes.
    ///
    /// # Errors
    /// [`ConfigError`] with one line per fault.
    pub fn read(file: Option<&Path>, flags: &BTreeMap<&'static str, Value>) -> Result<(Self, String), ConfigError> {
        read::read(file, flags)
    }

    /// Checks the configuration.
    ///
    /// # Errors
    /// [`ConfigError`] with one line per fault.
    pub fn check(&self) -> Result<(), ConfigError> {
        let faults = self.faults();
        if faults.is_empty() { Ok(()) } else { Err(ConfigError { faults }) }
    }

    fn faults(&self) -> Vec<String> {
        let mut faults = Faults::default();
        self.check_addresses(&mut faults);
        self.check_limits(&mut faults);
        self.check_roles(&mut faults);
        self.check_files(&mut faults);
        if let Some(auth) = &self.auth {
            check_auth(auth, &mut faults);
        }
        faults.0
    }

    /// Where the service listens, and for whom.
    fn check_addresses(&self, faults: &mut Faults) {
        if !self.listen.ip().is_loopback() && self.auth.is_none() {
            faults.add(format!(
                "listen: {} is not a loopback address, and without authentication anyone could read every session; \
                 configure [auth] (see deploy/README.md), or listen on 127.0.0.1 or ::1",
                self.listen
            ));
        }
        let nameless = self.allowed_hosts.iter().any(|host| host.trim().is_empty());
        faults.add_if(nameless, "allow_host: a name is empty; remove it");
        for origin in &self.origins {
            let fine = ["http://", "https://"].iter().any(|scheme| {
                origin.strip_prefix(scheme).is_some_and(|host| !host.is_empty() && !host.contains(['/', '*', ' ']))
            });
            if !fine {
                faults.add(format!("cors_origins: `{origin}` is not an origin such as https://plan.example"));
            }
        }
    }

    /// Numbers and times.
    fn check_limits(&self, faults: &mut Faults) {
        faults.add_if(self.threads > 1024, "threads: allowed is 0 to 1024");
        for (name, is_zero) in [
            ("max_surface_mb", self.limits.max_surface_bytes == 0),
            ("max_ct_mb", self.limits.max_ct_bytes == 0),
            ("max_json_mb", self.limits.max_json_bytes == 0),
            ("max_waiting", self.service.max_waiting == 0),
            ("max_waiting_tenant", self.service.max_waiting_tenant == 0),
            ("max_attempts", self.service.max_attempts == 0),
            ("max_wall_s", self.service.max_wall.is_zero()),
            ("stuck_after_s", self.service.stuck_after.is_zero()),
            ("session_quota_mb", self.service.session_quota == 0),
            ("session_retention_days", self.service.session_retention.is_some_and(|r| r.is_zero())),
            ("janitor_every_s", self.service.janitor_every.is_zero()),
            ("max_connections", self.connections.most == 0),
            ("write_timeout_s", self.connections.stalled.is_zero()),
            ("upload_idle_s", self.limits.upload_idle.is_zero()),
            ("body_timeout_s", self.limits.body.is_zero()),
            ("heartbeat_s", self.limits.heartbeat.is_zero()),
            ("answer_timeout_s", self.limits.answer.is_zero()),
        ] {
            if is_zero {
                faults.add(format!("{name}: must be above 0"));
            }
        }
        faults.add_if(!(1..=64).contains(&self.service.parallel_jobs), "parallel_jobs: allowed is 1 to 64");
        faults.add_if(!(2..=3600).contains(&self.service.lease.as_secs()), "lease_s: allowed is 2 to 3600");
        // The store keeps the ids of deleted objects longer than this limit.
        let kept = self.service.deleted_retention.as_secs();
        faults.add_if(kept > 7 * 86_400, "deleted_retention_s: allowed is 0 to 604800");
        // The timer adds it to the current time, so a huge value would overflow.
        let head = self.connections.head.as_secs();
        faults.add_if(!(1..=86_400).contains(&head), "header_timeout_s: allowed is 1 to 86400");
    }

    /// What this process does, and what it shares with others.
    fn check_roles(&self, faults: &mut Faults) {
        let (api, works, database) = (self.api, self.service.computes_jobs, self.places.database.is_some());
        faults.add_if(
            !works && !database,
            "worker: no other process can run the jobs of a data directory; name a database, or leave worker true",
        );
        faults.add_if(
            !(api && works) && database && self.places.blobs.is_none(),
            "blobs: API and worker processes on one database need a common bucket; name it",
        );
        faults.add_if(!api && !database, "database: a worker needs the database of the API processes; name it");
        faults.add_if(!api && !works, "worker: a process without API and jobs does nothing; set it to true");
    }

    /// What names other things: bucket, log level, collector, certificates.
    fn check_files(&self, faults: &mut Faults) {
        if let Some(Err(fault)) = self.places.blobs.as_ref().map(BucketUrl::open) {
            faults.add(format!("blobs: {}", chain(&fault)));
        }
        if let Err(fault) = log::check(&self.log_level) {
            faults.add(format!("log.level: {fault}"));
        }
        if let Some(Err(fault)) = self.otlp_endpoint.as_deref().map(otlp::check) {
            faults.add(format!("otlp.endpoint: {fault}"));
        }
        if let Some(Err(fault)) = self.tls.as_ref().map(tls::check) {
            faults.add(format!("tls: {fault}"));
        }
    }
}

fn check_auth(auth: &AuthSettings, faults: &mut Faults) {
    faults.add_if(auth.keys.is_empty() && auth.jwt.is_none(), "auth: neither a key nor an identity provider is given");
    faults.0.extend(faults_of(&auth.keys));
    for fault in auth.jwt.iter().flat_map(|jwt| jwt.faults()) {
        faults.add(format!("auth.jwt.{fault}"));
    }
}

/// Faults of API keys, a line each.
fn faults_of(keys: &[ApiKey]) -> Vec<String> {
    let mut faults = Vec::new();
    for (index, key) in keys.iter().enumerate() {
        faults.extend(key.faults().into_iter().map(|fault| format!("auth.keys[{index}]: {fault}")));
        if keys.iter().take(index).any(|other| other.id == key.id) {
            faults.push(format!("auth.keys[{index}]: another key has the id `{}` too; rename one", key.id));
        }
        if !key.hash.is_empty() && keys.iter().take(index).any(|other| other.hash == key.hash) {
            let id = &key.id;
            faults.push(format!(
                "auth.keys[{index}]: key `{id}` has the hash of another key, so one token would be both; make a new key"
            ));
        }
    }
    faults
}

/// Faults of a configuration, a line each.
#[derive(Debug, Default)]
struct Faults(Vec<String>);

impl Faults {
    fn add(&mut self, fault: String) {
        self.0.push(fault);
    }

    fn add_if(&mut self, wrong: bool, fault: &str) {
        if wrong {
            self.add(fault.to_owned());
        }
    }
}

/// The faults of a configuration.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}", faults.join("\n"))]
pub struct ConfigError {
    /// One line per fault.
    pub faults: Vec<String>,
}

/// Parses an address of `--listen`: `IP:PORT` or `localhost:PORT`.
///
/// # Errors
/// A message that names the text and the expected form.
pub fn parse_listen(text: &str) -> Result<SocketAddr, String> {
    let expected = || format!("`{text}` is not an address; expected IP:PORT such as 127.0.0.1:8080");
    if let Ok(address) = text.parse() {
        return Ok(address);
    }
    // Only localhost is resolved, so that the start does not depend on a name server.
    match text.strip_prefix("localhost:") {
        Some(_) => text.to_socket_addrs().ok().and_then(|mut a| a.find(|a| a.ip().is_loopback())).ok_or_else(expected),
        None => Err(expected()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::http::auth::{Scopes, new_key};
    use prosopon_store::TenantId;

    fn key(id: &str) -> ApiKey {
        let hash = new_key(id).unwrap().hash;
        ApiKey { id: id.to_owned(), tenant: TenantId::local(), scopes: Scopes::all(), hash }
    }

    #[test]
    fn only_loopback_is_served_without_authentication() {
        let mut config = ServeConfig::new(PathBuf::from("x"));
        for (text, ok) in [("127.0.0.1:0", true), ("[::1]:8080", true), ("0.0.0.0:8080", false), ("10.1.2.3:80", false)]
        {
            config.listen = parse_listen(text).unwrap();
            assert_eq!(config.check().is_ok(), ok, "{text}");
        }
        config.auth = Some(AuthSettings { keys: vec![key("a")], jwt: None });
        config.check().unwrap();
        config.auth = Some(AuthSettings::default());
        assert!(config.check().is_err(), "authentication that lets nobody in");
        assert!(parse_listen("localhost:0").unwrap().ip().is_loopback());
        assert!(parse_listen("example.com:80").is_err());
    }

    #[test]
    fn a_file_and_flags_are_read_and_hashes_are_not_printed() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("prosopon.toml");
        let key = key("front");
        let text = format!(
            "listen = \"127.0.0.1:9000\"\nmax_waiting = 7\nsession_retention_days = 30\nallow_host = [\"plan.example\"]\n\
             [log]\nformat = \"json\"\n[auth]\n[[auth.keys]]\nid = \"front\"\ntenant = \"hospital-a\"\n\
             scopes = [\"read\", \"write\"]\nhash = \"{}\"\n",
            key.hash
        );
        std::fs::write(&file, text).unwrap();
        let flags = BTreeMap::from([("data", Value::from("d")), ("max_waiting", Value::from(9u32))]);
        let (config, printed) = ServeConfig::read(Some(&file), &flags).unwrap();
        assert_eq!((config.listen.port(), config.service.max_waiting, config.data), (9000, 9, PathBuf::from("d")));
        assert_eq!(config.service.max_waiting_tenant, 4, "half of the queue, where there are tenants");
        assert_eq!(config.service.session_retention, Some(Duration::from_secs(30 * 86400)));
        assert_eq!((config.allowed_hosts, config.log_format), (vec!["plan.example".to_owned()], LogFormat::Json));
        let keys = config.auth.unwrap().keys;
        assert_eq!((keys[0].tenant.as_str(), keys[0].scopes.to_string().as_str()), ("hospital-a", "read write"));
        assert!(printed.contains("max_waiting = 9") && printed.contains("front"));
        assert!(!printed.contains("sha256"), "{printed}");
        // The printed configuration can be read again.
        std::fs::write(&file, &printed).unwrap();
        let (again, reprinted) = ServeConfig::read(Some(&file), &BTreeMap::new()).unwrap();
        assert_eq!((again.listen.port(), again.allowed_hosts), (9000, vec!["plan.example".to_owned()]));
        let settings = |text: &str| text.lines().filter(|l| !l.starts_with('#')).map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(settings(&reprinted), settings(&printed));
    }

    /// An empty tenant would be another one's: `local`.
    #[test]
    fn keys_with_empty_or_repeated_values_are_refused() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("prosopon.toml");
        let hash = key("a").hash;
        let entry = |id: &str, tenant: &str, scopes: &str, hash: &str| {
            format!("[[auth.keys]]\nid = {id:?}\ntenant = {tenant:?}\nscopes = {scopes}\nhash = {hash:?}\n")
        };
        let good = entry("a", "a", r#"["read"]"#, &hash);
        for (text, words) in [
            (entry("a", "", r#"["read"]"#, &hash), "auth.keys[0]: tenant ``"),
            (entry("a", " ", r#"["read"]"#, &hash), "auth.keys[0]: tenant ` `"),
            (entry("a", "a\t", r#"["read"]"#, &hash), "auth.keys[0]: tenant"),
            (
                format!("[[auth.keys]]\nid = \"a\"\nscopes = [\"read\"]\nhash = {hash:?}\n"),
                "auth.keys[0]: tenant is missing",
            ),
            (entry("", "a", r#"["read"]"#, &hash), "auth.keys[0]: id ``"),
            (entry(" ", "a", r#"["read"]"#, &hash), "auth.keys[0]: id ` `"),
            (entry("a", "a", "[]", &hash), "auth.keys[0]: key `a` has no scope"),
            (entry("a", "a", r#"[""]"#, &hash), "auth.keys[0]: scope"),
            (entry("a", "a", r#"["read"]"#, ""), "auth.keys[0]: the hash of key `a`"),
            (
                format!("{good}{}", entry("a", "b", r#"["read"]"#, &key("b").hash)),
                "auth.keys[1]: another key has the id `a`",
            ),
            (
                format!("{good}{}", entry("b", "b", r#"["read"]"#, &hash)),
                "auth.keys[1]: key `b` has the hash of another key",
            ),
            ("[auth]\nkeys = []\n".to_owned(), "auth: neither a key nor"),
        ] {
            std::fs::write(&file, format!("data = \"d\"\n{text}")).unwrap();
            let error = ServeConfig::read(Some(&file), &BTreeMap::new()).unwrap_err();
            assert!(error.faults.iter().any(|fault| fault.starts_with(words)), "{text}: {error}");
            if text.contains("[[") {
                let source = ConfigSource { file: file.clone(), flags: BTreeMap::new() };
                assert!(source.keys().is_err(), "the keys of a changed file: {text}");
            }
        }
    }

    #[test]
    fn all_faults_are_told_at_once_and_where_they_come_from() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("prosopon.toml");
        let text = "listen = \"nowhere\"\nmax_waiting = \"many\"\nmax_wating = 3\nmax_surface_mb = 0\ncors_origins = [\"*\"]\nallow_host = [\"\"]\n\
            header_timeout_s = 9223372036854775807\n[tls]\ncert = \"missing.pem\"\n[auth]\n[[auth.keys]]\nid = \"a\"\ntenant = \"A B\"\nscopes = [\"fly\"]\nhash = \"x\"\n\
            [[auth.keys]]\nid = \"b\"\n";
        std::fs::write(&file, text).unwrap();
        let error = ServeConfig::read(Some(&file), &BTreeMap::new()).unwrap_err();
        for (path, words) in [
            ("listen", "not an address"),
            ("max_waiting", "invalid type"),
            ("max_wating", "is not a setting"),
            ("max_surface_mb", "above 0"),
            ("cors_origins", "not an origin"),
            ("allow_host", "is empty"),
            ("header_timeout_s", "86400"),
            ("tls", "key"),
            ("auth.keys[0]", "tenant"),
            ("auth.keys[0]", "fly"),
            ("auth.keys[1]", "tenant is missing"),
            ("auth.keys[1]", "hash is missing"),
            ("data", "missing"),
        ] {
            let reported = |f: &String| f.starts_with(&format!("{path}:")) && f.contains(words);
            assert!(error.faults.iter().any(reported), "{path} {words}: {error}");
        }
        // All faults of one key are reported.
        for words in ["64 digits", "no scope"] {
            assert!(error.faults.iter().any(|f| f.starts_with("auth.keys[0]:") && f.contains(words)), "{error}");
        }
        for secret in [
            "[auth]\nkeys = \"sesame\"\n",
            "[[auth.keys]]\nid = \"a\"\nhash = $sesame$x\n",
            "[[auth.keys]]\nid = \"a\"\nhash = [\"sesame\"]\n",
            "[[auth.keys]]\nid = \"a\"\nscopes = \"sesame\"\n",
        ] {
            std::fs::write(&file, format!("data = \"d\"\n{secret}")).unwrap();
            let reported = ServeConfig::read(Some(&file), &BTreeMap::new()).unwrap_err().to_string();
            assert!(!reported.contains("sesame") && !reported.is_empty(), "{reported}");
        }
        std::fs::write(&file, "listen = \n").unwrap();
        for file in [file, directory.path().join("none.toml")] {
            let error = ServeConfig::read(Some(&file), &BTreeMap::new()).unwrap_err();
            assert!(error.faults.len() == 1 && !error.to_string().contains("data: missing"), "{error}");
        }
    }
}
