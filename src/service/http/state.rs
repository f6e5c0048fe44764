use std::sync::Arc;
use std::time::Duration;

use axum::extract::FromRef;
use metrics_exporter_prometheus::PrometheusHandle;

use super::auth::{Access, Links};
use prosopon_jobs::Service;

/// Limits of requests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HttpLimits {
    /// Largest surface upload, bytes.
    pub max_surface_bytes: u64,
    /// Largest CT upload, bytes.
    pub max_ct_bytes: u64,
    /// Largest JSON body, bytes.
    pub max_json_bytes: usize,
    /// Longest time without data within an upload.
    pub upload_idle: Duration,
    /// Longest time that a JSON body may take to arrive.
    pub body: Duration,
    /// Longest silence of an event stream; after it the service sends a heartbeat.
    pub heartbeat: Duration,
    /// Longest time until an answer starts.
    ///
    /// Long polls end earlier, and streams start at once.
    pub answer: Duration,
}

impl Default for HttpLimits {
    fn default() -> Self {
        Self {
            max_surface_bytes: 512 << 20,
            max_ct_bytes: 2 << 30,
            max_json_bytes: 8 << 20,
            upload_idle: Duration::from_secs(60),
            body: Duration::from_secs(30),
            heartbeat: Duration::from_secs(15),
            answer: Duration::from_secs(900),
        }
    }
}

/// State shared by all handlers.
#[derive(Debug, Clone)]
pub struct AppState {
    /// Sessions and jobs.
    pub service: Arc<Service>,
    /// Limits of requests.
    pub limits: HttpLimits,
    /// Renders the metrics; `None` without a recorder.
    pub metrics: Option<PrometheusHandle>,
    /// Host names, besides loopback, that the Host header can name.
    pub allowed_hosts: Arc<[String]>,
    /// Whether requests need a bearer token.
    pub access: Access,
    /// Signs links that need no token, and checks them.
    pub links: Links,
    /// Origins whose pages can use the service (CORS).
    pub origins: Arc<[String]>,
    /// Whether clients connect by TLS.
    pub tls: bool,
}

impl FromRef<AppState> for Arc<Service> {
    fn from_ref(state: &AppState) -> Self {
        Self::clone(&state.service)
    }
}

impl FromRef<AppState> for HttpLimits {
    fn from_ref(state: &AppState) -> Self {
        state.limits
    }
}
