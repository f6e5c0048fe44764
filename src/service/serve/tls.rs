use axum_server::tls_rustls::RustlsConfig;
use tokio_util::sync::CancellationToken;

use super::watch::Watch;
use crate::config::TlsFiles;

/// Reads certificate and key.
pub(super) async fn load(files: &TlsFiles) -> std::io::Result<RustlsConfig> {
    // A second start in the same process finds the provider installed.
    rustls::crypto::ring::default_provider().install_default().ok();
    RustlsConfig::from_pem_file(&files.cert, &files.key).await
}

/// Reads certificate and key again when they change, so that a renewed certificate needs no restart.
///
/// Files that cannot be read change nothing.
pub(super) async fn renew(config: RustlsConfig, files: TlsFiles, stop: CancellationToken) {
    let mut watch = Watch::new(vec![files.cert.clone(), files.key.clone()]);
    while watch.changed(&stop).await {
        match config.reload_from_pem_file(&files.cert, &files.key).await {
            Ok(()) => {
                watch.was_read();
                tracing::info!("the certificate was read again");
            }
            // Possibly only one of the two files has been replaced yet.
            Err(error) => tracing::error!(%error, "the certificate cannot be read; the old one stays in use"),
        }
    }
}
