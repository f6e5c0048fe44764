use std::time::Duration;

use super::Service;
use prosopon_store::StoreError;

/// Time between two attempts to write to a store that is away.
const PAUSE: Duration = Duration::from_secs(2);

impl Service {
    /// Writes what a job has made, however long the store is away: its work is not lost by that. What is written again must
    /// have the effect of one write, as those of a running job have.
    ///
    /// # Errors
    /// The store's: that it is away only when the service stops meanwhile.
    pub(super) async fn persist<T, W>(&self, write: impl Fn() -> W) -> Result<T, StoreError>
    where
        W: Future<Output = Result<T, StoreError>>,
    {
        loop {
            match write().await {
                Err(error) if error.is_away() && !self.stop.is_cancelled() => {
                    tracing::warn!(%error, "the result of a job cannot be stored yet");
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
