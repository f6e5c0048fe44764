use std::convert::Infallible;
use std::time::Duration;

use super::Service;
use super::running::Running;
use prosopon_store::JobRecord;

/// Longest time between two renewals of a lease; at each the worker also sees a cancellation request.
const RENEW_EVERY: Duration = Duration::from_secs(1);

pub(super) fn renew_every(lease: Duration) -> Duration {
    RENEW_EVERY.min(lease / 4)
}

/// Renews the lease of a running job.
///
/// Stops the job when the lease is lost or another process recorded a cancellation.
pub(super) async fn keep_lease(service: &Service, job: &JobRecord, running: &Running) -> Infallible {
    while service.store.is_shared() {
        tokio::time::sleep(renew_every(service.settings.lease)).await;
        match service.store.renew(job, service.settings.lease).await {
            Ok(Some(false)) => {}
            Ok(Some(true)) => _ = running.request_cancel(),
            Ok(None) => {
                tracing::warn!("the lease is lost: the job was deleted or claimed by another worker");
                running.control.cancel();
                break;
            }
            Err(error) => tracing::warn!(%error, "the lease of a job cannot be renewed; trying again"),
        }
    }
    std::future::pending().await
}
