use std::time::Duration;

use super::Service;
use prosopon_store::StoreError;

/// Time between two attempts to write to an unreachable store.
const PAUSE: Duration = Duration::from_secs(2);

impl Service {
    /// Stores a result of a job, and tries again while the store is unreachable, so that no work is lost.
    ///
    /// `write` may run several times and must then have the effect of one write, as the store's writes for running jobs do.
    ///
    /// # Errors
    /// The store's; that it is unreachable only when the service stops meanwhile.
    pub(super) async fn persist<T, W>(&self, write: impl Fn() -> W) -> Result<T, StoreError>
    where
        W: Future<Output = Result<T, StoreError>>,
    {
        loop {
            match write().await {
                Err(error) if error.is_unreachable() && !self.stop.is_cancelled() => {
                    tracing::warn!(%error, "the result of a job cannot be stored yet; trying again");
                    tokio::select! {
                        () = tokio::time::sleep(PAUSE) => {}
                        () = self.stop.cancelled() => {}
                    }
                }
                written => return written,
            }
        }
    }
}
