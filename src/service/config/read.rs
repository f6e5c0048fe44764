use std::collections::BTreeMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

use figment::error::Kind;
use serde::{Deserialize, Serialize};

use super::source::Source;
use super::{ConfigError, ConfigSource, ConnectionLimits, ServeConfig, TlsFiles, Value, faults_of, parse_listen};
use crate::http::HttpLimits;
use crate::http::auth::{ApiKey, AuthSettings, JwtSettings, Scope, Scopes};
use prosopon_jobs::ServiceSettings;
use prosopon_store::{Keyring, StoreLocation, TenantId};

const MB: u64 = 1 << 20;
const DAY_S: u64 = 86_400;

/// A list, or a text with commas, as environment variables have it.
#[derive(Debug, Deserialize, Serialize)]
#[serde(untagged)]
enum Names {
    List(Vec<String>),
    Text(String),
}

impl Names {
    fn list(self) -> Vec<String> {
        match self {
            Self::List(names) => names,
            Self::Text(text) => {
                text.split(',').map(str::trim).filter(|name| !name.is_empty()).map(str::to_owned).collect()
            }
        }
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeyEntry {
    id: Option<String>,
    tenant: Option<String>,
    scopes: Option<Vec<String>>,
    hash: Option<String>,
}

/// Reads the configuration; also returns its printed form, without hashes.
pub(super) fn read(
    file: Option<&Path>,
    flags: &BTreeMap<&'static str, Value>,
) -> Result<(ServeConfig, String), ConfigError> {
    let mut source = Source::new(file, flags);
    // A file that cannot be read gives no settings, so further faults would be misleading.
    if let Some(faults) = source.unreadable() {
        return Err(ConfigError { faults });
    }
    let s = &mut source;
    let listen: String = s.take("listen", "127.0.0.1:8080".to_owned());
    let listen = parse_listen(&listen);
    let data: Option<PathBuf> = s.take_optional("data");
    let mut config = ServeConfig::new(data.clone().unwrap_or_default());
    match listen {
        Ok(listen) => config.listen = listen,
        Err(fault) => s.fault("listen", &fault),
    }
    if data.is_none() && !s.faults.iter().any(|f| f.starts_with("data:")) {
        s.faults.push("data: missing; name the directory for sessions and results (--data DIR)".to_owned());
    }
    config.places = StoreLocation { database: address(s, "database"), blobs: address(s, "blobs"), keys: keyring(s) };
    config.threads = s.take("threads", config.threads);
    config.cache_bytes = megabytes(s.take("cache_mb", config.cache_bytes / MB));
    config.allowed_hosts = s.take("allow_host", Names::List(Vec::new())).list();
    config.origins = s.take("cors_origins", Names::List(Vec::new())).list();
    config.limits = limits(s);
    config.connections = connections(s);
    config.auth = auth(s);
    config.service = service(s, config.auth.is_some());
    config.tls = tls(s);
    config.drain = Duration::from_secs(s.take("drain_s", config.drain.as_secs()));
    config.log_level = s.take("log.level", config.log_level);
    config.log_format = s.take("log.format", config.log_format);
    config.otlp_endpoint = s.take_optional("otlp.endpoint");
    config.source = file.map(|file| ConfigSource { file: file.to_owned(), flags: flags.clone() });
    s.finish();
    let mut faults = std::mem::take(&mut source.faults);
    faults.extend(config.faults());
    let printed = source.used.iter().map(|(path, value)| format!("{path} = {value}\n")).collect();
    if faults.is_empty() { Ok((config, printed)) } else { Err(ConfigError { faults }) }
}

/// The API keys of a file.
pub(super) fn keys(file: &Path, flags: &BTreeMap<&'static str, Value>) -> Result<Vec<ApiKey>, ConfigError> {
    let mut source = Source::new(Some(file), flags);
    if let Some(faults) = source.unreadable() {
        return Err(ConfigError { faults });
    }
    let keys = auth(&mut source).map(|auth| auth.keys).unwrap_or_default();
    let mut faults = std::mem::take(&mut source.faults);
    faults.extend(faults_of(&keys));
    if faults.is_empty() { Ok(keys) } else { Err(ConfigError { faults }) }
}

/// The keys of blobs and backups in a file, if one is named, and in the environment.
pub(super) fn encryption(file: Option<&Path>) -> Result<Keyring, ConfigError> {
    let mut source = Source::new(file, &BTreeMap::new());
    if let Some(faults) = source.unreadable() {
        return Err(ConfigError { faults });
    }
    let keys = keyring(&mut source);
    if source.faults.is_empty() { Ok(keys) } else { Err(ConfigError { faults: source.faults }) }
}

fn keyring(s: &mut Source) -> Keyring {
    let keys = s.take_hidden::<Names>("encryption.keys", "a list of texts").map(Names::list);
    let file: Option<PathBuf> = s.take_optional("encryption.key_file");
    let read = match (keys, &file) {
        (None, None) => Ok(Keyring::default()),
        (Some(keys), None) if keys.is_empty() => {
            Err("keys: has no key; leave `encryption` out to store values as they are".to_owned())
        }
        (Some(keys), None) => Keyring::new(keys.iter().map(String::as_str)).map_err(|fault| format!("keys: {fault}")),
        (None, Some(file)) => std::fs::read_to_string(file)
            .map_err(|error| error.to_string())
            .and_then(|text| Keyring::of_file(&text))
            .map_err(|fault| format!("key_file: {}: {fault}", file.display())),
        (Some(_), Some(_)) => {
            Err("keys: give it or `key_file`, not both, be it in the file or in the environment".to_owned())
        }
    };
    match read {
        Ok(keys) => {
            if !keys.is_empty() {
                s.show("# encryption: ids of the keys", &keys.ids().collect::<Vec<_>>());
            }
            keys
        }
        Err(fault) => {
            s.faults.push(format!("encryption.{fault}"));
            Keyring::default()
        }
    }
}

/// An address; its printed form has no password.
fn address<T: FromStr<Err = String> + Display>(s: &mut Source, path: &'static str) -> Option<T> {
    match s.take_hidden::<String>(path, "a text")?.parse::<T>() {
        Ok(address) => {
            s.show(path, &address.to_string());
            Some(address)
        }
        Err(fault) => {
            s.fault(path, &fault);
            None
        }
    }
}

fn megabytes(mb: u64) -> u64 {
    mb.saturating_mul(MB)
}

fn limits(s: &mut Source) -> HttpLimits {
    let d = HttpLimits::default();
    let json = s.take("max_json_mb", d.max_json_bytes as u64 / MB);
    HttpLimits {
        max_surface_bytes: megabytes(s.take("max_surface_mb", d.max_surface_bytes / MB)),
        max_ct_bytes: megabytes(s.take("max_ct_mb", d.max_ct_bytes / MB)),
        max_json_bytes: usize::try_from(megabytes(json)).unwrap_or(usize::MAX),
        upload_idle: Duration::from_secs(s.take("upload_idle_s", d.upload_idle.as_secs())),
        body: Duration::from_secs(s.take("body_timeout_s", d.body.as_secs())),
        heartbeat: Duration::from_secs(s.take("heartbeat_s", d.heartbeat.as_secs())),
        answer: Duration::from_secs(s.take("answer_timeout_s", d.answer.as_secs())),
    }
}

fn connections(s: &mut Source) -> ConnectionLimits {
    let d = ConnectionLimits::default();
    ConnectionLimits {
        most: s.take("max_connections", d.most),
        head: Duration::from_secs(s.take("header_timeout_s", d.head.as_secs())),
        stalled: Duration::from_secs(s.take("write_timeout_s", d.stalled.as_secs())),
    }
}

fn service(s: &mut Source, has_tenants: bool) -> ServiceSettings {
    let d = ServiceSettings::default();
    let max_waiting = s.take("max_waiting", d.max_waiting);
    // A single tenant can use the whole queue; among several, none can fill it.
    let of_tenant = if has_tenants { (max_waiting / 2).max(1) } else { max_waiting };
    ServiceSettings {
        max_waiting,
        max_waiting_tenant: s.take("max_waiting_tenant", of_tenant),
        parallel_jobs: s.take("parallel_jobs", d.parallel_jobs),
        computes_jobs: s.take("worker", d.computes_jobs),
        runs_maintenance: d.runs_maintenance,
        lease: Duration::from_secs(s.take("lease_s", d.lease.as_secs())),
        max_attempts: s.take("max_attempts", d.max_attempts),
        memory_mb: s.take_optional("memory_mb").or(d.memory_mb),
        max_wall: Duration::from_secs(s.take("max_wall_s", d.max_wall.as_secs())),
        stuck_after: Duration::from_secs(s.take("stuck_after_s", d.stuck_after.as_secs())),
        session_quota: megabytes(s.take("session_quota_mb", d.session_quota / MB)),
        min_free: megabytes(s.take("min_free_mb", d.min_free / MB)),
        session_retention: s.take_optional("session_retention_days").map(days),
        deleted_retention: Duration::from_secs(s.take("deleted_retention_s", d.deleted_retention.as_secs())),
        event_retention: days(s.take("event_retention_days", d.event_retention.as_secs() / DAY_S)),
        comparison_retention: days(s.take("comparison_retention_days", d.comparison_retention.as_secs() / DAY_S)),
        janitor_every: Duration::from_secs(s.take("janitor_every_s", d.janitor_every.as_secs())),
        import: d.import,
    }
}

fn days(days: u64) -> Duration {
    Duration::from_secs(days.saturating_mul(DAY_S))
}

fn tls(s: &mut Source) -> Option<TlsFiles> {
    match (s.take_optional("tls.cert"), s.take_optional("tls.key")) {
        (Some(cert), Some(key)) => Some(TlsFiles { cert, key }),
        (None, None) => None,
        (Some(_), None) | (None, Some(_)) => {
            s.faults.push("tls: cert or key is missing; give both".to_owned());
            None
        }
    }
}

fn auth(s: &mut Source) -> Option<AuthSettings> {
    let entries: Option<Vec<Value>> = s.take_hidden("auth.keys", "a list of [[auth.keys]] tables");
    let mut keys = Vec::new();
    for (index, entry) in entries.iter().flatten().enumerate() {
        match entry.deserialize::<KeyEntry>() {
            Ok(entry) => keys.push(api_key(s, index, entry)),
            Err(error) => s.faults.push(format!("auth.keys[{index}]: {}", unquoted(&error))),
        }
    }
    let shown: Vec<String> = keys.iter().map(|k| format!("{} ({}; {})", k.id, k.tenant, k.scopes)).collect();
    if !shown.is_empty() {
        // The hash is not printed, so the keys are printed as a comment.
        s.show("# auth.keys", &shown);
    }
    let jwt = jwt(s);
    (entries.is_some() || jwt.is_some()).then_some(AuthSettings { keys, jwt })
}

/// The fault of an entry, without its values, which can be secret.
fn unquoted(error: &figment::Error) -> String {
    let field = if error.path.is_empty() { "a value".to_owned() } else { error.path.join(".") };
    if let Kind::InvalidType(_, expected) | Kind::InvalidValue(_, expected) = &error.kind {
        return format!("{field} is not {expected}");
    }
    error.kind.to_string()
}

fn api_key(s: &mut Source, index: usize, entry: KeyEntry) -> ApiKey {
    let mut fault = |detail: String| s.faults.push(format!("auth.keys[{index}]: {detail}"));
    let mut given = |name: &str, value: Option<String>| {
        value.unwrap_or_else(|| {
            fault(format!("{name} is missing"));
            String::new()
        })
    };
    let (id, hash) = (given("id", entry.id), given("hash", entry.hash));
    let tenant = match entry.tenant {
        Some(tenant) => tenant.parse().map_err(|e| fault(format!("tenant `{tenant}`: {e}"))).ok(),
        None => {
            fault("tenant is missing".to_owned());
            None
        }
    };
    let scope = |name: String| name.parse::<Scope>().map_err(|e| fault(format!("scope {e}"))).ok();
    let scopes: Scopes = entry.scopes.unwrap_or_default().into_iter().filter_map(scope).collect();
    // The service does not start with a fault; the placeholder allows the check of the other values.
    let tenant = tenant.unwrap_or_else(TenantId::local);
    ApiKey { id, tenant, scopes, hash }
}

fn jwt(s: &mut Source) -> Option<JwtSettings> {
    let issuer: Option<String> = s.take_optional("auth.jwt.issuer");
    let audience: Option<String> = s.take_optional("auth.jwt.audience");
    let jwks_file: Option<PathBuf> = s.take_optional("auth.jwt.jwks_file");
    let tenant_claim: Option<String> = s.take_optional("auth.jwt.tenant_claim");
    let scope_claim: Option<String> = s.take_optional("auth.jwt.scope_claim");
    let leeway_s: Option<u64> = s.take_optional("auth.jwt.leeway_s");
    match (issuer, audience, jwks_file) {
        (Some(issuer), Some(audience), Some(jwks_file)) => Some(JwtSettings {
            issuer,
            audience,
            jwks_file,
            tenant_claim: tenant_claim.unwrap_or_else(|| "tenant".to_owned()),
            scope_claim: scope_claim.unwrap_or_else(|| "scope".to_owned()),
            leeway: Duration::from_secs(leeway_s.unwrap_or(30)),
        }),
        (None, None, None) if tenant_claim.is_none() && scope_claim.is_none() && leeway_s.is_none() => None,
        _ => {
            s.faults.push("auth.jwt: issuer, audience or jwks_file is missing; give all three".to_owned());
            None
        }
    }
}
