use std::sync::Arc;

use tokio_util::sync::CancellationToken;

use super::watch::Watch;
use crate::config::{ConfigSource, ServeConfig};
use crate::http::auth::Authenticator;

/// Reads the API keys again when the configuration changes, so that a key can be revoked without a restart.
///
/// A configuration with faults changes nothing. All other settings take a restart.
pub(super) async fn renew(authenticator: Arc<Authenticator>, source: ConfigSource, stop: CancellationToken) {
    let mut watch = Watch::new(vec![source.file.clone()]);
    while watch.changed(&stop).await {
        match ServeConfig::read(Some(&source.file), &source.flags) {
            Ok((ServeConfig { auth: Some(auth), .. }, _)) => {
                watch.was_read();
                tracing::info!(keys = auth.keys.len(), "the API keys were read again");
                authenticator.set_keys(auth.keys);
            }
            Ok((ServeConfig { auth: None, .. }, _)) => {
                watch.was_read();
                tracing::error!("the configuration has no [auth] any more: the old keys stay in use until a restart");
            }
            Err(error) => tracing::error!(%error, "the configuration has faults: the old API keys stay in use"),
        }
    }
}
