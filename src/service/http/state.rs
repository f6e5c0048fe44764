use std::sync::Arc;
use std::time::Duration;

use axum::extract::FromRef;
use metrics_exporter_prometheus::PrometheusHandle;

use super::auth::Access;
use prosopon_jobs::Service;

/// Bounds on requests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HttpLimits {
    /// Longest surface upload, bytes.
    pub max_surface_bytes: u64,
    /// Longest CT upload, bytes.
    pub max_ct_bytes: u64,
    /// Longest JSON body, bytes.
    pub max_json_bytes: usize,
    /// Longest silence within an upload.
    pub upload_idle: Duration,
    /// Longest time that a JSON body may take to arrive.
    pub body: Duration,
    /// Longest silence of a stream of events.
    pub heartbeat: Duration,
    /// Longest time to an answer; long polls and streams are shorter or begin at once.
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

/// What handlers share.
#[derive(Debug, Clone)]
pub struct AppState {
    /// Sessions and jobs.
    pub service: Arc<Service>,
    /// Bounds on requests.
    pub limits: HttpLimits,
    /// Renders the metrics, where a recorder is installed.
    pub metrics: Option<PrometheusHandle>,
    /// Host names besides loopback that requests may be for.
    pub allowed_hosts: Arc<[String]>,
    /// Whether requests must say who sends them.
    pub access: Access,
    /// Origins whose pages may use the service.
    pub origins: Arc<[String]>,
    /// Whether it is met by TLS.
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
