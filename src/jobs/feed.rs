use std::sync::Arc;

use tokio::sync::watch;

use super::Service;
use crate::session::Fault;
use crate::store::{EventRecord, JobId};

/// Events of one job as they are stored, from a given number on.
#[derive(Debug)]
pub struct EventFeed {
    service: Arc<Service>,
    changes: watch::Receiver<u64>,
    job: JobId,
    last: u64,
    ended: bool,
}

impl EventFeed {
    /// Events after number `last`.
    #[must_use]
    pub fn new(service: Arc<Service>, job: JobId, last: u64) -> Self {
        let changes = service.watch_changes();
        Self { service, changes, job, last, ended: false }
    }

    /// The next events in order; none after `end`, when the job is gone, or when the service stops.
    ///
    /// # Errors
    /// The store's.
    pub async fn next(&mut self) -> Result<Vec<EventRecord>, Fault> {
        let stopping = self.service.stopping().clone();
        while !self.ended {
            self.changes.borrow_and_update();
            // Before the events: a job that ends in between has its last ones among them or sends a change.
            let job = self.service.store().job(self.job).await?;
            let events = self.service.store().events(self.job, self.last).await?;
            if let Some(last) = events.last() {
                self.last = last.seq;
                self.ended = last.kind == "end";
                return Ok(events);
            }
            // A job that ended has said so, so the client has seen it; a deleted one will never say more.
            if job.is_none_or(|job| job.state.has_ended()) {
                break;
            }
            tokio::select! {
                changed = self.changes.changed() => if changed.is_err() { break },
                () = stopping.cancelled() => break,
            }
        }
        self.ended = true;
        Ok(Vec::new())
    }
}
