use std::net::IpAddr;

use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, Version, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::http::auth::Access;
use crate::http::{AppState, Problem};
use prosopon_contract::FaultKind;

/// Tells how a browser came to send a request.
const SEC_FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");

/// Refuses requests for foreign hosts, and writes that foreign web pages make.
///
/// Without the first check, a foreign web page that resolves its own name to loopback (DNS rebinding) could reach a service without
/// authentication. With authentication, hosts are checked only if some are configured. Without the second, any page in the
/// user's browser could write to such a service: browsers withhold only the answer. Requests with a token need no such check.
pub(in crate::http) async fn check_host(State(state): State<AppState>, request: Request, next: Next) -> Response {
    match refusal(&state, &request) {
        Some(problem) => problem.into_response(),
        None => next.run(request).await,
    }
}

fn refusal(state: &AppState, request: &Request) -> Option<Problem> {
    let (allowed, has_tokens) = (&state.allowed_hosts, matches!(state.access, Access::Tokens(_)));
    // RFC 9112, 3.2. HTTP/2 has the host in the URI, and HTTP/1.0 needs none.
    let hosts = request.headers().get_all(header::HOST).iter().count();
    if hosts > 1 || (hosts == 0 && request.version() == Version::HTTP_11) {
        return Some(Problem::new(
            FaultKind::MalformedRequest,
            format!("the request has {hosts} Host headers, not one"),
        ));
    }
    if has_tokens && allowed.is_empty() {
        return None;
    }
    let host = request.headers().get(header::HOST).map(|h| h.to_str().unwrap_or_default());
    let host = host.or_else(|| request.uri().authority().map(Authority::as_str));
    if host.is_some_and(|host| !is_allowed(host, allowed)) {
        let detail = "the Host header names neither loopback nor an allowed host; allow it with --allow-host";
        return Some(Problem::new(FaultKind::ForeignHost, detail));
    }
    let writes = ![Method::GET, Method::HEAD, Method::OPTIONS].contains(request.method());
    if !has_tokens && writes && is_foreign(request.headers(), host.unwrap_or_default(), &state.origins) {
        let detail = "a page of another origin may not write; allow its origin with `cors_origins`, or use tokens";
        return Some(Problem::new(FaultKind::ForeignOrigin, detail));
    }
    None
}

fn is_allowed(host: &str, allowed: &[String]) -> bool {
    let Ok(authority) = host.parse::<Authority>() else { return false };
    let name = authority.host();
    // The whole header is the name and perhaps a port: nothing before it (user information), nothing between.
    let port =
        host.strip_prefix(name).and_then(|rest| if rest.is_empty() { Some("0") } else { rest.strip_prefix(':') });
    if port.is_none_or(|port| port.parse::<u16>().is_err()) {
        return false;
    }
    let bare = match name.strip_prefix('[') {
        Some(v6) => v6.strip_suffix(']').unwrap_or_default(),
        None => name,
    };
    name.eq_ignore_ascii_case("localhost")
        || bare.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
        || allowed.iter().any(|a| a.eq_ignore_ascii_case(name) || a.eq_ignore_ascii_case(bare))
}

/// Whether a web page of another origin than the service at `host` and the `allowed` ones sent a request.
///
/// Programs other than browsers send neither header.
fn is_foreign(headers: &HeaderMap, host: &str, allowed: &[String]) -> bool {
    let is_own = |origin: &str| match origin.split_once("://") {
        Some((scheme, authority)) => {
            let default_port = if scheme == "https" { ":443" } else { ":80" };
            authority.eq_ignore_ascii_case(host.strip_suffix(default_port).unwrap_or(host))
        }
        None => false,
    };
    let is_allowed = |origin: &HeaderValue| {
        let origin = origin.to_str().unwrap_or_default();
        is_own(origin) || allowed.iter().any(|a| a.eq_ignore_ascii_case(origin))
    };
    let mut origins = headers.get_all(header::ORIGIN).iter().peekable();
    if origins.peek().is_some() {
        return !origins.all(is_allowed);
    }
    !headers.get_all(SEC_FETCH_SITE).iter().all(|site| site == "same-origin" || site == "none")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loopback_and_given_names_only() {
        for host in ["localhost", "LOCALHOST:80", "127.0.0.1:8080", "127.9.9.9", "[::1]:8080", "plan.example:1"] {
            assert!(is_allowed(host, &["plan.example".to_owned()]), "{host}");
        }
        for host in ["evil.example", "10.0.0.1:8080", "localhost.evil.example", "", "[fe80::1]"].into_iter().chain([
            "[::1].evil.example",
            "localhost:80@evil.example",
            "localhost:x",
            "[::1",
            "::1",
        ]) {
            assert!(!is_allowed(host, &["plan.example".to_owned()]), "{host}");
        }
    }

    #[test]
    fn an_allowed_address_needs_no_brackets() {
        for allowed in ["fe80::1", "[fe80::1]"] {
            assert!(is_allowed("[fe80::1]:8080", &[allowed.to_owned()]), "{allowed}");
        }
    }

    #[test]
    fn pages_of_other_origins_are_foreign() {
        let foreign = |name: HeaderName, value: &'static str| {
            let headers = HeaderMap::from_iter([(name, value.parse().unwrap())]);
            is_foreign(&headers, "localhost:8080", &["https://plan.example".to_owned()])
        };
        for origin in ["http://localhost:8080", "https://plan.example", "https://localhost:8080"] {
            assert!(!foreign(header::ORIGIN, origin), "{origin}");
        }
        for origin in
            ["null", "http://localhost:3000", "https://evil.example", "http://localhost:8080.evil.example", ""]
        {
            assert!(foreign(header::ORIGIN, origin), "{origin}");
        }
        for (site, is) in [("none", false), ("same-origin", false), ("same-site", true), ("cross-site", true)] {
            assert_eq!(foreign(SEC_FETCH_SITE, site), is, "{site}");
        }
        assert!(!is_foreign(&HeaderMap::new(), "localhost:8080", &[]), "a program");
        let mut two = HeaderMap::from_iter([(header::ORIGIN, "http://localhost".parse().unwrap())]);
        assert!(!is_foreign(&two, "localhost:80", &[]) && is_foreign(&two, "localhost:443", &[]));
        two.append(header::ORIGIN, "https://evil.example".parse().unwrap());
        assert!(is_foreign(&two, "localhost", &[]), "all of several must be allowed");
    }
}
