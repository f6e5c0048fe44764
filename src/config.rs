//! Configuration of the service, one struct a concern, checked once at start.

use std::net::{SocketAddr, ToSocketAddrs};
use std::path::PathBuf;

use crate::http::HttpLimits;
use crate::jobs::ServiceSettings;

/// Everything that `prosopon serve` is told.
#[derive(Debug, Clone, PartialEq)]
pub struct ServeConfig {
    /// Loopback address; port 0 picks a free one.
    pub listen: SocketAddr,
    /// Where sessions and results are kept.
    pub data: PathBuf,
    /// Threads for numerics; 0 is one a core.
    pub threads: usize,
    /// Host names besides loopback that requests may be for (a proxy's).
    pub allowed_hosts: Vec<String>,
    /// Bounds on requests.
    pub limits: HttpLimits,
    /// Bounds on jobs and uploads' content.
    pub service: ServiceSettings,
}

impl ServeConfig {
    /// Defaults for a data directory, on a free loopback port.
    #[must_use]
    pub fn new(data: PathBuf) -> Self {
        Self {
            listen: SocketAddr::from(([127, 0, 0, 1], 0)),
            data,
            threads: 0,
            allowed_hosts: Vec::new(),
            limits: HttpLimits::default(),
            service: ServiceSettings::default(),
        }
    }

    /// All faults of the configuration.
    ///
    /// # Errors
    /// [`ConfigError`] with one line a fault.
    pub fn check(&self) -> Result<(), ConfigError> {
        let mut faults = Vec::new();
        if !self.listen.ip().is_loopback() {
            faults.push(format!(
                "--listen {} is not a loopback address: this version has no authentication, so it serves 127.0.0.1 and ::1 \
                 only (put an authenticating proxy in front to reach it from elsewhere)",
                self.listen
            ));
        }
        if self.threads > 1024 {
            faults.push(format!("--threads is {}, allowed is 0 to 1024", self.threads));
        }
        if self.limits.max_surface_bytes == 0 || self.limits.max_ct_bytes == 0 {
            faults.push("upload limits must be above 0".to_owned());
        }
        if faults.is_empty() { Ok(()) } else { Err(ConfigError { faults }) }
    }
}

/// What is wrong with the configuration.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}", faults.join("\n"))]
pub struct ConfigError {
    /// One line a fault.
    pub faults: Vec<String>,
}

/// An address as `--listen` takes it: `IP:PORT` or `localhost:PORT`.
///
/// # Errors
/// What is wrong with it.
pub fn parse_listen(text: &str) -> Result<SocketAddr, String> {
    let expected = || format!("`{text}` is no address; expected IP:PORT such as 127.0.0.1:8080");
    if let Ok(address) = text.parse() {
        return Ok(address);
    }
    // Names are looked up for localhost only, so that nothing depends on a name server.
    match text.strip_prefix("localhost:") {
        Some(_) => text.to_socket_addrs().ok().and_then(|mut a| a.find(|a| a.ip().is_loopback())).ok_or_else(expected),
        None => Err(expected()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_loopback_is_served() {
        let mut config = ServeConfig::new(PathBuf::from("x"));
        for (text, ok) in [("127.0.0.1:0", true), ("[::1]:8080", true), ("0.0.0.0:8080", false), ("10.1.2.3:80", false)]
        {
            config.listen = parse_listen(text).unwrap();
            assert_eq!(config.check().is_ok(), ok, "{text}");
        }
        assert!(parse_listen("localhost:0").unwrap().ip().is_loopback());
        assert!(parse_listen("example.com:80").is_err());
    }
}
