//! Other processes on the same store: their events are passed on, and jobs that they left are taken over.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::Service;
use super::running::Running;
use super::worker::recover;
use crate::store::{JobRecord, Lane};

/// Longest time without a look at what others did: word of it may be lost.
const LOOK_EVERY: Duration = Duration::from_secs(2);
/// Shortest time between two looks.
const PAUSE: Duration = Duration::from_millis(100);
/// Longest time between two renewals of a lease: by one a worker learns that its job shall stop.
const RENEW_EVERY: Duration = Duration::from_secs(1);

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

/// Takes over jobs whose workers have not been heard of, until the service stops. Where the database was silent the workers could not be heard:
/// they have time to renew their leases before anything is taken from them.
pub(super) async fn take_over(service: Arc<Service>) {
    let lease = service.settings.lease;
    let (mut heard_since, mut was_slow) = (Instant::now(), false);
    loop {
        tokio::select! {
            () = tokio::time::sleep(lease / 4) => {}
            () = service.stop.cancelled() => return,
        }
        let asked = Instant::now();
        let taken = async {
            let abandoned = service.store.abandoned().await?;
            let slow = asked.elapsed() > lease / 4;
            // One that is always slow is heard all the same.
            if slow && !was_slow {
                heard_since = Instant::now();
            }
            was_slow = slow;
            let trusted = heard_since.elapsed() >= lease / 2;
            recover(&service, if trusted { abandoned } else { Vec::new() }).await
        };
        if let Err(fault) = taken.await {
            heard_since = Instant::now();
            tracing::error!(detail = fault.detail, "jobs that others left cannot be taken over");
        }
    }
}

/// Keeps a job its worker's, and stops it when it was lost, or when another process was asked to stop it.
pub(super) async fn keep_lease(service: &Service, job: &JobRecord, running: &Running) -> Infallible {
    let every = RENEW_EVERY.min(service.settings.lease / 4);
    while service.store.is_shared() {
        tokio::time::sleep(every).await;
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
