//! Other processes on the same store: their events are passed on, and jobs that they left are taken over.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use super::Service;
use super::running::Running;
use super::worker::recover;
use prosopon_store::{JobRecord, Lane, StoreError};

/// Longest time without a look at what others did: word of it may be lost.
const LOOK_EVERY: Duration = Duration::from_secs(2);
/// Shortest time between two looks.
const PAUSE: Duration = Duration::from_millis(100);
/// Longest time between two renewals of a lease: by one a worker learns that its job shall stop.
const RENEW_EVERY: Duration = Duration::from_secs(1);
/// How often one looks again for a sign of a worker's life before its job is taken from it.
const LOOKS: u32 = 2;

/// Passes on that others may have changed something, until the service stops.
pub(super) async fn follow(service: Arc<Service>) {
    let mut changes = None;
    loop {
        if changes.is_none() {
            changes = service.store.changes().await.unwrap_or_default();
        }
        let word = async {
            match &mut changes {
                Some(changes) => changes.next(LOOK_EVERY).await,
                None => {
                    tokio::time::sleep(LOOK_EVERY).await;
                    true
                }
            }
        };
        let queue = tokio::select! {
            queue = word => queue,
            () = service.stop.cancelled() => return,
        };
        service.announce();
        if queue {
            for lane in Lane::ALL {
                service.woken(lane).notify_waiters();
            }
        }
        tokio::time::sleep(PAUSE).await;
    }
}

/// Takes over jobs whose workers have not been heard of, until the service stops.
pub(super) async fn take_over(service: Arc<Service>) {
    loop {
        tokio::select! {
            () = tokio::time::sleep(service.settings.lease / 4) => {}
            () = service.stop.cancelled() => return,
        }
        let taken = async { recover(&service, silent(&service).await?).await };
        if let Err(fault) = taken.await {
            tracing::error!(detail = fault.detail, "jobs that others left cannot be taken over");
        }
    }
}

/// Jobs whose leases have passed and of which nothing is heard while the database answers several times. A lease that has passed says nothing
/// by itself: the database may have been silent, or each of its answers takes long.
async fn silent(service: &Service) -> Result<Vec<JobRecord>, StoreError> {
    let lease = service.settings.lease;
    let mut silent = service.store.abandoned().await?;
    for _ in 0..LOOKS {
        if silent.is_empty() || service.stop.is_cancelled() {
            return Ok(Vec::new());
        }
        tokio::time::sleep(renew_every(lease).max(lease / 8)).await;
        let still = service.store.abandoned().await?;
        silent.retain(|job| still.contains(job));
    }
    Ok(silent)
}

fn renew_every(lease: Duration) -> Duration {
    RENEW_EVERY.min(lease / 4)
}

/// Keeps a job its worker's, and stops it when it was lost, or when another process was asked to stop it.
pub(super) async fn keep_lease(service: &Service, job: &JobRecord, running: &Running) -> Infallible {
    while service.store.is_shared() {
        tokio::time::sleep(renew_every(service.settings.lease)).await;
        match service.store.renew(job, service.settings.lease).await {
            Ok(Some(false)) => {}
            Ok(Some(true)) => _ = running.request_cancel(),
            Ok(None) => {
                tracing::warn!("the job was deleted, or given to another worker");
                running.control.cancel();
                break;
            }
            Err(error) => tracing::warn!(%error, "the lease of a job cannot be renewed now"),
        }
    }
    std::future::pending().await
}
