use axum::http::Uri;

/// Checks the address of a collector: plain HTTP without password and query.
///
/// The client for spans has no TLS; a collector on the same machine forwards the spans.
pub(super) fn check(endpoint: &str) -> Result<(), String> {
    let fine = |uri: &Uri| {
        let host = uri.authority().is_some_and(|a| !a.host().is_empty() && !a.as_str().contains('@'));
        uri.scheme_str() == Some("http") && host && uri.query().is_none()
    };
    // The message does not quote the address, which can contain a password.
    let expected = "expected an http:// address without password and query, such as http://127.0.0.1:4318";
    endpoint.parse().ok().filter(fine).map(|_| ()).ok_or_else(|| expected.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_of_collectors_are_plain_http_without_passwords() {
        for fine in ["http://127.0.0.1:4318", "http://collector", "http://[::1]:4318/base/"] {
            assert_eq!(check(fine), Ok(()), "{fine}");
        }
        for faulty in
            ["", "127.0.0.1:4318", "https://collector", "http://", "http://a:secret@collector", "http://c?key=1"]
        {
            assert!(check(faulty).is_err_and(|fault| !fault.contains("secret")), "{faulty}");
        }
    }
}
