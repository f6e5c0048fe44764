use std::sync::Arc;

use tokio_util::sync::CancellationToken;

use super::watch::Watch;
use crate::config::ConfigSource;
use crate::http::auth::Authenticator;

/// Reads the API keys again when the configuration changes, so that a key can be revoked without a restart.
///
/// A file that cannot be read, and keys with faults, change nothing. All other settings take a restart.
pub(super) async fn renew(authenticator: Arc<Authenticator>, source: ConfigSource, stop: CancellationToken) {
    let mut watch = Watch::new(vec![source.file.clone()]);
    while watch.changed(&stop).await {
        match source.keys() {
            Ok(keys) => {
                watch.was_read();
                tracing::info!(keys = keys.len(), "the API keys were read again");
                authenticator.set_keys(keys);
            }
            Err(error) => tracing::error!(%error, "the old API keys stay in use"),
        }
    }
}
