//! Watches the other processes on the same store: passes on their changes and takes over the jobs that they abandoned.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::Service;
use super::lease::renew_every;
use super::recovery::recover;
use prosopon_store::{JobRecord, Lane, StoreError};

/// Longest time without a check for changes, because a notification may be lost.
const LOOK_EVERY: Duration = Duration::from_secs(2);
/// Shortest time between two checks.
const PAUSE: Duration = Duration::from_millis(100);
/// Number of further checks of an expired lease before its job is taken over.
const LOOKS: u32 = 2;

/// Passes on notifications of other processes until the service stops.
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

/// Takes over jobs whose workers do not renew their leases, until the service stops.
pub(super) async fn take_over(service: Arc<Service>) {
    loop {
        tokio::select! {
            () = tokio::time::sleep(service.settings.lease / 4) => {}
            () = service.stop.cancelled() => return,
        }
        let taken = async { recover(&service, silent(&service).await?).await };
        if let Err(fault) = taken.await {
            tracing::error!(detail = fault.detail, "abandoned jobs of other processes cannot be taken over");
        }
    }
}

/// Finds the jobs whose lease has expired and that no worker renews during [`LOOKS`] further checks.
///
/// One expired lease does not show that the worker is gone: the database may have been unreachable or slow. So a check that
/// the database answered late finds nothing: the worker's renewals were late too.
async fn silent(service: &Service) -> Result<Vec<JobRecord>, StoreError> {
    let lease = service.settings.lease;
    let Some(mut silent) = look(service).await? else { return Ok(Vec::new()) };
    for _ in 0..LOOKS {
        if silent.is_empty() || service.stop.is_cancelled() {
            return Ok(Vec::new());
        }
        tokio::time::sleep(renew_every(lease).max(lease / 8)).await;
        let Some(still) = look(service).await? else { return Ok(Vec::new()) };
        silent.retain(|job| still.contains(job));
    }
    Ok(silent)
}

/// The jobs with expired leases; `None` when the database took longer to answer than a worker waits between renewals.
async fn look(service: &Service) -> Result<Option<Vec<JobRecord>>, StoreError> {
    let begin = Instant::now();
    let abandoned = service.store.abandoned().await?;
    if begin.elapsed() < renew_every(service.settings.lease) {
        return Ok(Some(abandoned));
    }
    if !abandoned.is_empty() {
        let (jobs, answer_s) = (abandoned.len(), begin.elapsed().as_secs_f64());
        tracing::warn!(
            jobs,
            answer_s,
            "jobs with expired leases are not taken over, because the database answers late"
        );
    }
    Ok(None)
}
