use rustls::ServerConfig;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};

use super::TlsFiles;

/// Checks that certificate and key can be read and belong together.
pub(super) fn check(files: &TlsFiles) -> Result<(), String> {
    let unusable = |file: &std::path::Path, why: &dyn std::fmt::Display| format!("{}: {why}", file.display());
    let chain: Vec<CertificateDer<'static>> = CertificateDer::pem_file_iter(&files.cert)
        .and_then(Iterator::collect)
        .map_err(|e| unusable(&files.cert, &e))?;
    if chain.is_empty() {
        return Err(unusable(&files.cert, &"contains no certificate"));
    }
    let key = PrivateKeyDer::from_pem_file(&files.key).map_err(|e| unusable(&files.key, &e))?;
    let provider = rustls::crypto::ring::default_provider();
    let config = ServerConfig::builder_with_provider(provider.into()).with_safe_default_protocol_versions();
    let config = config.map_err(|e| e.to_string())?.with_no_client_auth().with_single_cert(chain, key);
    config.map(|_| ()).map_err(|e| format!("certificate and key cannot be used together: {e}"))
}
