use std::net::IpAddr;

use axum::extract::{Request, State};
use axum::http::header;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::http::auth::Access;
use crate::http::{AppState, Problem};
use prosopon_contract::FaultKind;

/// Refuses requests whose Host header names neither loopback nor an allowed host.
///
/// Without this check, a foreign web page that resolves its own name to loopback (DNS rebinding) could reach a service without
/// authentication. With authentication, hosts are checked only if some are configured.
pub(in crate::http) async fn check_host(State(state): State<AppState>, request: Request, next: Next) -> Response {
    let allowed = &state.allowed_hosts;
    if matches!(state.access, Access::Tokens(_)) && allowed.is_empty() {
        return next.run(request).await;
    }
    let host = request.headers().get(header::HOST).and_then(|h| h.to_str().ok());
    let host = host.or_else(|| request.uri().host());
    match host {
        // In-process calls have no host.
        None => next.run(request).await,
        Some(host) if is_allowed(host, allowed) => next.run(request).await,
        Some(_) => {
            let detail = "the Host header names neither loopback nor an allowed host; allow it with --allow-host";
            Problem::new(FaultKind::ForeignHost, detail).into_response()
        }
    }
}

fn is_allowed(host: &str, allowed: &[String]) -> bool {
    let name = match host.strip_prefix('[') {
        Some(v6) => v6.split(']').next().unwrap_or_default(),
        None => host.rsplit_once(':').map_or(host, |(name, _)| name),
    };
    name.eq_ignore_ascii_case("localhost")
        || name.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
        || allowed.iter().any(|a| a.eq_ignore_ascii_case(name))
}

#[cfg(test)]
mod tests {
    use super::is_allowed;

    #[test]
    fn loopback_and_given_names_only() {
        for host in ["localhost", "LOCALHOST:80", "127.0.0.1:8080", "127.9.9.9", "[::1]:8080", "plan.example:1"] {
            assert!(is_allowed(host, &["plan.example".to_owned()]), "{host}");
        }
        for host in ["evil.example", "10.0.0.1:8080", "localhost.evil.example", "", "[fe80::1]"] {
            assert!(!is_allowed(host, &["plan.example".to_owned()]), "{host}");
        }
    }
}
