use std::sync::Arc;

use tokio::sync::watch;

use super::Service;
use super::events::end_event;
use prosopon_contract::{Fault, FaultKind};
use prosopon_store::{EventRecord, JobId, JobState};

/// Events of one job as they are stored, from a given number on.
///
/// When events after that number are not stored any more, the first event is `resync`: the client reads the job's status and
/// continues from there.
#[derive(Debug)]
pub struct EventFeed {
    service: Arc<Service>,
    changes: watch::Receiver<u64>,
    job: JobId,
    last: u64,
    /// Event to send first.
    resync: Option<EventRecord>,
    ended: bool,
}

impl EventFeed {
    /// Opens a feed of the events after number `last`.
    ///
    /// # Errors
    /// As [`Service::job`].
    pub async fn open(service: Arc<Service>, job: JobId, last: u64) -> Result<Self, Fault> {
        let changes = service.watch_changes();
        let record = service.job(job).await?;
        let events = service.store().events(job, 0).await?;
        let newest = events.last().map_or(0, |e| e.seq);
        let resync = |seq| {
            let data = serde_json::json!({ "status": record.state.as_str(), "attempt": record.attempt });
            EventRecord { seq, kind: "resync".to_owned(), data: data.to_string() }
        };
        let begins_at = record.events_from.saturating_sub(1);
        let (last, resync) = if last > newest {
            // The number comes from another history of the job, for example from before a backup was restored.
            (begins_at, Some(resync(begins_at)))
        } else if last < begins_at {
            (begins_at, Some(resync(begins_at)))
        } else {
            (last, None)
        };
        let ended = record.state.has_ended() && resync.is_none() && newest <= last;
        Ok(Self { service, changes, job, last, resync, ended })
    }

    /// Number of the last event that was returned.
    #[must_use]
    pub fn last(&self) -> u64 {
        self.last
    }

    /// Whether no event will follow: the job has ended and all its events were returned.
    #[must_use]
    pub fn is_spent(&self) -> bool {
        self.ended
    }

    /// The next events in order; empty after `end` and when the service stops.
    ///
    /// A job that is deleted with its session ends as cancelled, with a problem that says so.
    ///
    /// # Errors
    /// The store's.
    pub async fn next(&mut self) -> Result<Vec<EventRecord>, Fault> {
        if let Some(resync) = self.resync.take() {
            return Ok(vec![resync]);
        }
        let stopping = self.service.stopping().clone();
        while !self.ended {
            self.changes.borrow_and_update();
            // Read before the events: if the job ends in between, its last events are among them or trigger a change.
            let job = self.service.store().job(self.job).await?;
            let events = self.service.store().events(self.job, self.last).await?;
            if let Some(last) = events.last() {
                self.last = last.seq;
                self.ended = last.kind == "end";
                return Ok(events);
            }
            match job {
                // The events were deleted with the session, so the last event is made here.
                None => {
                    self.ended = true;
                    self.last += 1;
                    return Ok(vec![EventRecord { seq: self.last, ..deleted(self.job) }]);
                }
                // The client has received the last event.
                Some(job) if job.state.has_ended() => break,
                Some(_) => {}
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

/// The last event of a deleted job.
fn deleted(job: JobId) -> EventRecord {
    let fault = Fault::new(FaultKind::Gone, format!("job {job} was deleted with its session"));
    let (kind, data) = end_event(JobState::Cancelled, Some(&fault), None);
    EventRecord { seq: 0, kind: kind.to_owned(), data }
}
