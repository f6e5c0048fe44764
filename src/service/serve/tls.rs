use std::path::Path;
use std::time::{Duration, SystemTime};

use axum_server::tls_rustls::RustlsConfig;
use tokio_util::sync::CancellationToken;

use crate::config::TlsFiles;

/// Time between two checks whether the files have changed.
const LOOK_EVERY: Duration = Duration::from_secs(5);

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
    let mut seen = changed(&files);
    loop {
        tokio::select! {
            () = tokio::time::sleep(LOOK_EVERY) => {}
            () = stop.cancelled() => return,
        }
        let now = changed(&files);
        if now == seen {
            continue;
        }
        match config.reload_from_pem_file(&files.cert, &files.key).await {
            Ok(()) => {
                seen = now;
                tracing::info!("the certificate was read again");
            }
            // Possibly only one of the two files has been replaced yet.
            Err(error) => tracing::error!(%error, "the certificate cannot be read; the old one stays in use"),
        }
    }
}

fn changed(files: &TlsFiles) -> [Option<SystemTime>; 2] {
    let at = |file: &Path| std::fs::metadata(file).and_then(|m| m.modified()).ok();
    [at(&files.cert), at(&files.key)]
}
